import type { PassiveWalker, Read, State } from "./passive-walker.js";

export interface Settings {
  walker?: string;
  /** Parameters of the walker that differ from the preset's. */
  changes?: Record<string, number>;
  slope?: number;
  /** Hip torque that is held, in m g l. */
  torque?: number;
  policy?: string;
  ground?: "smooth" | "rough" | "rougher" | "waves";
  /** 1 is the walker's own pace. */
  speed?: number;
  seed?: number;
  /** State on the Poincaré section to start from. */
  start?: State;
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
  walk: PassiveWalker;
  settings: Required<Settings>;
  running: boolean;
  begin(): Promise<void>;
  /** Changes settings; `again` begins again after a fall. */
  set(changes: Settings, again?: boolean): Promise<void>;
  push(impulse: number): void;
  toggle(): void;
  next(): void;
  advance(seconds: number): void;
  draw(): void;
  stop(): void;
}

export function play(root: HTMLElement, options?: Options): Promise<Player>;
