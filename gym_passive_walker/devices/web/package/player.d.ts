import type { PassiveWalker, Read, State, SystemWalker } from "./passive-walker.js";

export interface Settings {
  /** Name of a system of one's own in Python's `web.build`; `walker`, `torque` and `policy` are refused beside it. */
  system?: string;
  /** Controls of a system that are held, by name. */
  controls?: Record<string, number>;
  walker?: string;
  /** Parameters of the walker that differ from the preset's; fields of a system's body. */
  changes?: Record<string, number>;
  slope?: number;
  /** Hip torque that is held, in m g l; refused beside a policy. */
  torque?: number;
  /** Name of a policy, which has its own walker and slope unless they are given. */
  policy?: string;
  ground?: "smooth" | "rough" | "rougher" | "waves";
  /** 1 is the walker's own pace. */
  speed?: number;
  seed?: number;
  /** State on the Poincaré section to start from. */
  start?: State | number[];
}

export interface Options extends Settings {
  /** Whether the page's address keeps the settings. */
  share?: boolean;
  /** Whether the plots and the parameters are hidden. */
  compact?: boolean;
  paused?: boolean;
  read?: Read;
  /** Called after each control step and each change of the settings. */
  onstate?: (player: Player) => void;
}

export class Player {
  walk: PassiveWalker | SystemWalker;
  settings: Required<Settings>;
  running: boolean;
  begin(): Promise<void>;
  /** Changes settings; `again` begins again after a fall. */
  set(changes: Settings, again?: boolean): Promise<void>;
  push(impulse: number): void;
  toggle(): void;
  next(): void;
  /** Begins a video of the picture; or ends it, and saves its file. */
  record(): void;
  advance(seconds: number): void;
  draw(): void;
  stop(): void;
}

export function play(root: HTMLElement, options?: Options): Promise<Player>;
