/** A number of the walker's state: angles in rad, then angular velocities in sqrt(g/l). */
export type State = number[];

export type Preset = "A" | "B" | "C" | "D" | "E" | "F" | "lab" | "lab-straight";

/** McGeer's parameters; see the documentation's page on walkers. */
export interface Parameters {
  thigh_length: number;
  thigh_offset: number;
  thigh_mass: number;
  thigh_gyration: number;
  thigh_com: number;
  shank_length: number;
  shank_offset: number;
  shank_mass: number;
  shank_gyration: number;
  shank_com: number;
  foot_radius: number;
  foot_angle: number;
  hip_mass: number;
  hip_stiffness: number;
  hip_friction: number;
  knee_stiffness: number;
  knees: boolean;
  gravity: number;
}

export type WalkerLike = Preset | (Partial<Parameters> & { preset?: Preset });

export type Terrain =
  | { rough: { height_std?: number; slope_std?: number } }
  | { stairs: { rise: number } }
  | { waves: { height: number; strides: number } }
  | { footholds: { heights?: number[]; slopes?: number[] } }
  | { rises: number[]; slopes: number[]; repeats?: boolean; height_std?: number; slope_std?: number };

export type Channel = "hip" | "ankle" | "push_off";

/** Arguments of a scene, as of `PassiveWalkerEnv` in Python; all numbers are dimensionless. */
export interface Scene {
  walker?: WalkerLike;
  slope?: number;
  control?: "tick" | "stride";
  tick?: number;
  actions?: Channel[] | Channel;
  max_hip_torque?: number | null;
  max_ankle_torque?: number;
  max_push_off?: number;
  energy_weight?: number;
  energy?: "absolute" | "positive" | "net";
  end_on_toe_stub?: boolean | null;
  reset_noise_scale?: number | null;
  start?: State | null;
  max_stride_time?: number;
  tolerance?: 1e-6 | 1e-8 | 1e-10 | 1e-12;
  pushes?: { rate: number; impulse: number | [number, number] } | Record<string, never>;
  observation_noise?: number | number[];
  action_noise?: number;
  action_delay?: number;
  command?: number | [number, number] | null;
  command_weight?: number;
  terrain?: Terrain | null;
  terrain_lookahead?: number;
  step_limit?: number;
}

export type SceneName = "level" | "steep" | "rolling" | "lab" | "rough" | "pushed" | "push-off" | "commanded";

export type OutcomeName =
  | "RUNNING"
  | "HEELSTRIKE"
  | "KNEESTRIKE"
  | "FELL_FORWARD"
  | "FELL_BACKWARD"
  | "SWING_OVERROTATION"
  | "STUBBED_TOE"
  | "KNEE_NOT_LOCKED"
  | "STALLED"
  | "DIVERGED";

/** Measures of a step; those of a stride stand only where one ends. */
export interface Info {
  distance: number;
  energy: number;
  episode_distance: number;
  episode_energy: number;
  strides: number;
  outcome?: OutcomeName;
  step_length?: number;
  step_period?: number;
  speed?: number;
  cost_of_transport?: number;
  gravity_cost?: number;
  hip_cost?: number;
  net_hip_cost?: number;
  ankle_cost?: number;
  net_ankle_cost?: number;
  push_off_cost?: number;
  collision_cost?: number;
  friction_cost?: number;
  kneestrike_time?: number;
}

export interface Step {
  observation: Float32Array;
  reward: number;
  terminated: boolean;
  truncated: boolean;
  info: Info;
}

/** One application of the stride map, dimensionless. */
export interface Stride {
  outcome: OutcomeName;
  state: State;
  duration: number;
  step_length: number;
  gravity_work: number;
  spring_work: number;
  push_work: number;
  knee_time: number;
  knee_loss: number;
  heel_loss: number;
  friction_loss: number;
}

export interface Gait {
  state: State;
  /** Floquet multipliers [re, im], by finite differences of strides. */
  multipliers: [number, number][];
  stride: Stride;
}

export type Point = [number, number];

export interface Joints {
  contact: Point;
  hip: Point;
  stance_knee: Point;
  stance_foot: Point;
  stance_tip: Point;
  swing_knee: Point;
  swing_foot: Point;
  swing_tip: Point;
  shank: number;
  stance: number;
}

/** The walker at an instant, for a picture. */
export interface Frame {
  state: State;
  strides: number;
  joints: Joints;
}

export interface Colors {
  background: string;
  ground: string;
  mark: string;
  even: string;
  odd: string;
  body: string;
  push: string;
}

/** Reads a file of the package by its name. */
export type Read = (name: string) => Promise<Uint8Array>;

export class WalkerError extends Error {}
export class SceneError extends Error {}

export class PassiveWalker {
  readonly walker: Parameters;
  readonly scene: Required<Scene>;
  /** Of this episode, in rad. */
  readonly slope: number;
  readonly timeUnit: number;
  readonly legLength: number;
  readonly observation: Float32Array;
  readonly over: boolean;
  readonly outcome: OutcomeName | null;
  readonly info: Info;
  /** Duration of the last step in sqrt(l/g). */
  readonly duration: number;
  readonly state: State;
  readonly time: number;
  readonly strides: number;
  readonly kneeFree: boolean;
  readonly contact: number;
  readonly footholds: { strides: number; x: number; y: number }[];
  reset(options?: {
    seed?: number | bigint;
    state?: State | null;
    /** Of this episode, instead of the scene's. */
    slope?: number | null;
    noise?: boolean;
  }): Float32Array;
  step(action?: ArrayLike<number> | null): Step;
  stride(action?: ArrayLike<number> | null): Info & { state: State; steps: number };
  strideFrom(
    state: State,
    options?: {
      slope?: number;
      hip_torque?: number;
      ankle_torque?: number;
      push_off?: number;
      height_change?: number;
      slope_change?: number;
      tolerance?: 1e-6 | 1e-8 | 1e-10 | 1e-12;
    },
  ): Stride;
  startingState(slope?: number): State;
  findGait(options?: { guess?: State | null; hip_torque?: number; slope?: number; tries?: number }): Gait | null;
  /** An impulse on the hip when the next control step begins, positive downhill; pushes add. */
  push(impulse: number): void;
  change(options: { walker?: WalkerLike | null; scene?: Scene }): void;
  joints(state?: State): Joints;
  frame(): Frame;
  /** The walker within the last step, at a share from 0 to 1 of it. */
  within(share: number): Frame;
  render(
    canvas: HTMLCanvasElement,
    options?: { colors?: Partial<Colors>; frame?: Frame; width?: number; push?: number | null },
  ): void;
}

export interface Library {
  version: string;
  parameters: string[];
  walkers: Record<Preset, { kind: string; about: string; parameters: Parameters; gaits: [number, State][] }>;
  scenes: Record<SceneName, Scene>;
  policies: Record<string, { algo: string; activation: string; scene: Scene }>;
}

export interface Policy {
  name: string;
  scene: Scene;
  predict(observation: ArrayLike<number>): number[];
}

export function create(
  walker?: WalkerLike | null,
  scene?: Scene | SceneName,
  options?: { read?: Read },
): Promise<PassiveWalker>;
/** A stride of a system of one's own. */
export interface SystemStride {
  outcome: string;
  state: number[];
  duration: number;
  step_length: number;
  heel_loss: number;
}

export interface SystemFrame {
  state: number[];
  strides: number;
  lines: [number, number][][];
  /** Where the stance foot is. */
  contact: [number, number];
}

/** A system of one's own, compiled by `web.build(folder, systems)` of the Python package. */
export class SystemWalker {
  readonly name: string;
  /** Fields of the body and their values. */
  readonly fields: Record<string, number>;
  readonly controls: string[];
  readonly slope: number;
  readonly terrain: Terrain | null;
  readonly strides: number;
  /** How the last stride ended, or null within one. */
  readonly outcome: string | null;
  readonly over: boolean;
  /** Length of the last control step, in sqrt(l/g). */
  readonly duration: number;
  /** Coordinates, then their rates. */
  readonly state: number[];
  readonly footholds: { strides: number; x: number; y: number }[];
  change(changes: { slope?: number; body?: Record<string, number> }): void;
  reset(state?: number[] | null, options?: { seed?: number | bigint }): void;
  strideFrom(
    state: number[],
    options?: { controls?: number[] | null; end?: number; slope?: number; height_change?: number },
  ): SystemStride;
  /** Walks for a time in sqrt(l/g), or to the next heelstrike. */
  step(duration?: number, controls?: number[] | null): string | null;
  /** An impulse on the centre of mass when the next control step begins, positive downhill; pushes add. */
  push(impulse: number): void;
  findGait(options?: { guess?: number[] | null; controls?: number[] | null; slope?: number; tries?: number }): {
    state: number[]; multipliers: [number, number][]; stride: SystemStride;
  } | null;
  lines(state?: number[]): [number, number][][];
  frame(): SystemFrame;
  /** The system within the last control step, at a share from 0 to 1 of it. */
  within(share: number): SystemFrame;
  render(
    canvas: HTMLCanvasElement,
    options?: { colors?: Partial<Colors>; frame?: SystemFrame; width?: number; push?: number | null },
  ): void;
}

export function createSystem(
  name: string,
  options?: {
    slope?: number;
    body?: Record<string, number>;
    state?: number[] | null;
    /** Footholds of different heights. */
    terrain?: Terrain | null;
    seed?: number | bigint;
    tolerance?: number;
    read?: Read;
  },
): Promise<SystemWalker>;

export function library(read?: Read): Promise<Library>;
export function loadPolicy(name: string, options?: { read?: Read }): Promise<Policy>;
export function readFile(name: string): Promise<Uint8Array>;
export function checkWalker(given: WalkerLike, data: Library): Parameters;
export function checkScene(given: Scene, walker: Parameters, data: Library): Required<Scene>;
export function terrainFrom(value: Terrain | null | undefined): Terrain | null;
