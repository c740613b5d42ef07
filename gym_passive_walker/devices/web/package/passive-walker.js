// Passive walkers as exact hybrid systems, compiled from gym_passive_walker to WebAssembly.
//
//     import { create } from "./passive-walker.js";
//     const walk = await create("lab", { slope: 0.036, max_hip_torque: 0 });
//     walk.reset();
//     walk.step([0]);
//     walk.render(document.querySelector("canvas"));
//
// Numbers are bitwise those of the Python package. This file holds no equation of motion.

const STACK = 1 << 18; // bytes
const FOOTHOLDS = 4096; // room for a terrain's table
const PAGE = 65536;
const SECTION = "gym_passive_walker";
const SOLE_SPAN = 0.5; // half the angle in rad that a foot's arc spans in pictures

/** A walker's parameters describe no walker; the message says which, and what is allowed. */
export class WalkerError extends Error {
  name = "WalkerError";
}

/** The arguments describe no scene; the message says which, and what is allowed. */
export class SceneError extends Error {
  name = "SceneError";
}

// ---------------------------------------------------------------------------------------------
// Messages, in Python's words.

/** The text of a value as Python's repr writes it. */
function shown(value) {
  if (typeof value === "string") return value.includes("'") ? `"${value}"` : `'${value}'`;
  if (value === null || value === undefined) return "None";
  if (value === true) return "True";
  if (value === false) return "False";
  if (typeof value === "number") return float(value);
  if (Array.isArray(value)) return `[${value.map(shown).join(", ")}]`;
  if (typeof value === "object") {
    return `{${Object.entries(value).map(([k, v]) => `${shown(k)}: ${shown(v)}`).join(", ")}}`;
  }
  return String(value);
}

/** A number as Python writes a float. */
function float(x) {
  if (Number.isNaN(x)) return "nan";
  if (!Number.isFinite(x)) return x > 0 ? "inf" : "-inf";
  const size = Math.abs(x);
  if (size !== 0 && (size < 1e-4 || size >= 1e16)) {
    const [digits, power] = x.toExponential().split("e");
    const sign = power[0] === "-" ? "-" : "+";
    return `${digits}e${sign}${power.replace(/[+-]/, "").padStart(2, "0")}`;
  }
  const text = Object.is(x, -0) ? "-0" : String(x);
  return text.includes(".") ? text : `${text}.0`;
}

/** A number to six digits, as Python's format "g". */
function short(x, digits = 6) {
  if (x === 0) return "0";
  const power = Math.floor(Math.log10(Math.abs(Number(x.toPrecision(digits)))));
  if (power < -4 || power >= digits) {
    const [number, exponent] = x.toExponential(digits - 1).split("e");
    const sign = exponent[0] === "-" ? "-" : "+";
    const plain = number.includes(".") ? number.replace(/\.?0+$/, "") : number;
    return `${plain}e${sign}${exponent.replace(/[+-]/, "").padStart(2, "0")}`;
  }
  const text = x.toPrecision(digits);
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

/** How alike two words are: twice the length of their common parts over both lengths. */
function likeness(a, b) {
  function common(a0, a1, b0, b1) {
    let best = 0, where = 0, there = 0;
    for (let i = a0; i < a1; i++) {
      for (let j = b0; j < b1; j++) {
        let k = 0;
        while (i + k < a1 && j + k < b1 && a[i + k] === b[j + k]) k++;
        if (k > best) [best, where, there] = [k, i, j];
      }
    }
    if (!best) return 0;
    return best + common(a0, where, b0, there) + common(where + best, a1, there + best, b1);
  }
  return (2 * common(0, a.length, 0, b.length)) / (a.length + b.length || 1);
}

/** A message on unknown names, with similar known ones; null if all are known. */
function unknown(names, known, owner) {
  const strange = names.filter((name) => !known.includes(name));
  if (!strange.length) return null;
  const said = strange.map((name) => {
    const scored = known.map((other) => [likeness(other, name), other]);
    const [score, near] = scored.reduce((a, b) => (b[0] > a[0] ? b : a), [0, ""]);
    return score >= 0.6 ? `${name} (${near}?)` : name;
  });
  return `${owner} has no ${said.join(", ")}; it has ${known.join(", ")}`;
}

/** An object's own entry; undefined for a name that only its prototype has. */
const entry = (object, name) => (Object.hasOwn(object, name) ? object[name] : undefined);

/** The entries of an object given to a call, without those of its prototype; others are refused. */
function options(given, known, owner) {
  if (given === null || typeof given !== "object" || Array.isArray(given)) {
    throw new SceneError(`${owner} takes an object with some of ${known.join(", ")}, not ${shown(given)}`);
  }
  const said = unknown(Object.keys(given), known, owner);
  if (said) throw new SceneError(said);
  const own = Object.entries(given).filter(([, value]) => value !== undefined);
  return Object.assign(Object.create(null), Object.fromEntries(own));
}

function finite(name, value) {
  if (typeof value !== "number" || !Number.isFinite(value)) {
    throw new SceneError(`${name} must be a finite number, not ${shown(value)}`);
  }
  return value;
}

// ---------------------------------------------------------------------------------------------
// What a user gives, checked as in Python.

const PLACES = [
  "thigh_com", "thigh_offset", "thigh_gyration", "shank_com", "shank_offset", "shank_gyration",
];
const NOT_NEGATIVE = [
  "thigh_mass", "shank_mass", "hip_mass", "thigh_gyration", "shank_gyration", "hip_stiffness",
  "hip_friction", "knee_stiffness",
];
const FITTINGS = ["hip_stiffness", "hip_friction", "knee_stiffness"];
const NEEDED = [
  "thigh_length", "thigh_mass", "shank_length", "shank_mass",
];
const LEFT_OPEN = { knees: true, gravity: 9.81 };

/** All parameters of a walker, from a preset's name or from parameters; checked. */
export function checkWalker(given, data) {
  if (typeof given === "string") {
    const preset = entry(data.walkers, given);
    if (preset) return { ...preset.parameters };
    const names = Object.keys(data.walkers).join(", ");
    throw new WalkerError(`no walker ${shown(given)}: give one of the names ${names}, or an object of parameters`);
  }
  if (given === null || typeof given !== "object" || Array.isArray(given)) {
    throw new WalkerError(`no walker ${shown(given)}: give a preset's name or an object of parameters`);
  }
  const known = [...data.parameters.slice(0, -1), "knees", "gravity"];
  const { preset, ...parameters } = Object.assign(Object.create(null), given);
  if (preset !== undefined && !entry(data.walkers, preset)) {
    throw new WalkerError(`no preset ${shown(preset)}: choose from ${Object.keys(data.walkers).join(", ")}`);
  }
  const said = unknown(Object.keys(parameters), known, "a walker");
  if (said) throw new WalkerError(said);
  const base = preset === undefined ? {} : data.walkers[preset].parameters;
  const walker = {};
  for (const name of known) {
    const value = parameters[name] !== undefined ? parameters[name] : base[name] ?? LEFT_OPEN[name] ?? 0;
    if (!(name in parameters) && !(name in base) && NEEDED.includes(name)) {
      throw new WalkerError(`no walker ${shown(given)}: it needs ${name}; change a preset, one of ${Object.keys(data.walkers).join(", ")}`);
    }
    if (name === "knees") {
      if (value === "held") throw new WalkerError("knees='held' is not for pages: knees must be True or False there");
      if (typeof value !== "boolean") throw new WalkerError(`knees must be True, False or 'held', not ${shown(value)}`);
    } else if (typeof value !== "number") {
      throw new WalkerError(`${name} must be a number, not ${shown(value)}`);
    } else if (!Number.isFinite(value)) {
      throw new WalkerError(`${name} must be finite, not ${float(value)}`);
    }
    walker[name] = value;
  }
  checkSizes(walker);
  checkMasses(walker);
  return walker;
}

function checkSizes(walker) {
  for (const name of ["thigh_length", "shank_length", "gravity"]) {
    if (walker[name] <= 0) throw new WalkerError(`${name} must be positive, not ${float(walker[name])}`);
  }
  for (const name of NOT_NEGATIVE) {
    if (walker[name] < 0) throw new WalkerError(`${name} must not be negative, but is ${float(walker[name])}`);
  }
  if (!(walker.foot_radius >= 0 && walker.foot_radius < walker.shank_length)) {
    throw new WalkerError(
      `foot_radius must lie from 0 to below the shank's length ${float(walker.shank_length)}, ` +
        `so that the foot's centre is below the knee; it is ${float(walker.foot_radius)}`,
    );
  }
  const reach = (walker.shank_length - walker.foot_radius) / walker.thigh_length;
  const angle = walker.foot_angle;
  if (!(Math.abs(angle) < Math.PI / 2 && Math.abs(Math.sin(angle)) < reach)) {
    throw new WalkerError(
      `foot_angle ${float(angle)} rad cannot be reached by this shank: its size must ` +
        `be below ${short(Math.asin(Math.min(1, reach)))} rad (sin of it below (l_s - R)/l_t)`,
    );
  }
  const farthest = 2 * (walker.thigh_length + walker.shank_length);
  for (const name of PLACES) {
    if (Math.abs(walker[name]) > farthest) {
      throw new WalkerError(
        `${name} must be at most two leg lengths, ${short(farthest)}, for the mass to ` +
          `belong to a leg; it is ${float(walker[name])}`,
      );
    }
  }
}

function checkMasses(walker) {
  if (walker.thigh_mass === 0 && walker.shank_mass === 0) {
    if (walker.hip_mass === 0) throw new WalkerError("a walker needs mass: thigh_mass, shank_mass and hip_mass are 0");
    if (walker.knees || walker.foot_radius !== 0) {
      throw new WalkerError(
        "legs without mass are the simplest walker, which has point feet and no " +
          "knees: set foot_radius=0 and knees=False, or give the legs some mass",
      );
    }
    return;
  }
  const thigh = Math.hypot(walker.thigh_gyration, walker.thigh_com, walker.thigh_offset);
  const shank = Math.hypot(walker.shank_gyration, walker.shank_com, walker.shank_offset);
  if (walker.knees && walker.shank_mass * shank === 0) {
    throw new WalkerError(
      "a free shank needs a moment of inertia about the knee: give it shank_mass and " +
        "one of shank_com, shank_offset, shank_gyration, or set knees=False",
    );
  }
  if (walker.shank_mass === 0 && walker.thigh_mass * thigh === 0) {
    throw new WalkerError(
      "a swing leg needs a moment of inertia about the hip: move some of its mass away " +
        "from the hip, or set both leg masses to 0 for the simplest walker",
    );
  }
}

/** The kind of equations that a walker obeys: "kneed", "straight" or "simplest". */
function kindOf(walker) {
  if (walker.thigh_mass === 0 && walker.shank_mass === 0) return "simplest";
  return walker.knees ? "kneed" : "straight";
}

const SCENE = {
  slope: 0, control: "tick", tick: 0.1, actions: ["hip"], max_hip_torque: null,
  max_ankle_torque: 0.05, max_push_off: 0.2, energy_weight: 10, energy: "absolute",
  end_on_toe_stub: null, reset_noise_scale: null, start: null, max_stride_time: 20,
  tolerance: 1e-8, pushes: {}, observation_noise: 0, action_noise: 0, action_delay: 0,
  command: null, command_weight: 2, terrain: null, terrain_lookahead: 0, step_limit: Infinity,
};
const LARGEST = { hip: "max_hip_torque", ankle: "max_ankle_torque", push_off: "max_push_off" };

function bounded(name, value, low, high) {
  if (typeof value !== "number" || !(value >= low && value <= high)) {
    throw new SceneError(`${name} must be a number from ${short(low)} to ${short(high)}, not ${shown(value)}`);
  }
  return value;
}

function range(name, value, low, high) {
  const ends = Array.isArray(value) ? value : [value];
  const fine = [1, 2].includes(ends.length) && ends.every((x) => typeof x === "number");
  if (!fine || !(low <= ends[0] && ends[0] <= ends[ends.length - 1] && ends[ends.length - 1] <= high)) {
    throw new SceneError(
      `${name} must be a number from ${short(low)} to ${short(high)}, or a range of them as (low, high), not ${shown(value)}`,
    );
  }
  return [ends[0], ends[ends.length - 1]];
}

function whole(name, value, least, most, of = "") {
  if (!Number.isInteger(value) || value < least || value > most) {
    const limit = value > most ? `from ${least} to ${most}` : `from ${least} on`;
    throw new SceneError(`${name} must be a whole number ${limit}, not ${shown(value)}${of}`);
  }
  return value;
}

/** A scene with all its arguments, for a walker; checked. */
export function checkScene(given, walker, data) {
  const { walker: _, ...arguments_ } = Object.assign(Object.create(null), given);
  for (const name of data.in_python) {
    const value = arguments_[name];
    const empty = value === null || value === undefined || value === false ||
      (typeof value === "object" && !Object.keys(value).length);
    if (name in arguments_ && !empty) {
      throw new SceneError(`${name} is available in Python only: leave it out`);
    }
    delete arguments_[name];
  }
  const said = unknown(Object.keys(arguments_), Object.keys(SCENE), "a scene");
  if (said) throw new SceneError(said);
  const scene = { ...SCENE, ...arguments_ };
  if (typeof scene.step_limit !== "number" || !(scene.step_limit >= 1)) {
    throw new SceneError(`step_limit must be a number from 1 on, not ${shown(scene.step_limit)}`);
  }
  if (typeof scene.slope !== "number" || !(Math.abs(scene.slope) < Math.PI / 2)) {
    throw new SceneError(`slope must be an angle in rad between -pi/2 and pi/2, not ${shown(scene.slope)}`);
  }
  for (const [name, names] of [["control", ["tick", "stride"]], ["energy", data.energies]]) {
    if (!names.includes(scene[name])) {
      throw new SceneError(`${name} must be ${names.map(shown).join(" or ")}, not ${shown(scene[name])}`);
    }
  }
  const ticks = scene.control === "tick";
  scene.max_hip_torque ??= ticks ? 0.05 : 0.03;
  scene.reset_noise_scale ??= ticks ? 0.1 : 0.05;
  scene.end_on_toe_stub ??= walker.knees;
  if (typeof scene.end_on_toe_stub !== "boolean") {
    throw new SceneError(`end_on_toe_stub must be True or False, not ${shown(scene.end_on_toe_stub)}`);
  }
  if (scene.end_on_toe_stub && !walker.knees) {
    throw new SceneError("end_on_toe_stub is a rule for walkers with knees: straight legs always scuff");
  }
  bounded("tick", scene.tick, 1e-3, 1e3);
  for (const name of data.channels) bounded(LARGEST[name], scene[LARGEST[name]], 0, 1e3);
  checkActions(scene, walker, data);
  bounded("energy_weight", scene.energy_weight, 0, 1e6);
  bounded("reset_noise_scale", scene.reset_noise_scale, 0, 0.9);
  bounded("max_stride_time", scene.max_stride_time, 0.1, 1e3);
  if (![1e-6, 1e-8, 1e-10, 1e-12].includes(scene.tolerance)) {
    throw new SceneError(`tolerance must be 1e-06, 1e-08, 1e-10 or 1e-12 in a page, not ${shown(scene.tolerance)}`);
  }
  scene.pushes ??= {};
  if (typeof scene.pushes !== "object" || Object.keys(scene.pushes).length) {
    if (Object.keys(scene.pushes).sort().join() !== "impulse,rate") {
      throw new SceneError(
        "pushes must have a rate, how many there are in sqrt(l/g), and an impulse as a range " +
          `in m sqrt(g l): {"rate": 0.05, "impulse": (-0.05, 0.05)}, not ${shown(scene.pushes)}`,
      );
    }
    scene.pushes = {
      rate: bounded("pushes['rate']", scene.pushes.rate, 0, 100),
      impulse: range("pushes['impulse']", scene.pushes.impulse, -10, 10),
    };
  }
  const noise = scene.observation_noise;
  if (Array.isArray(noise)) {
    if (noise.length !== 8) {
      throw new SceneError(
        "observation_noise must be a number, of angles and rates, or 8 of them, one for each " +
          `entry of the observation, not ${shown(noise)}`,
      );
    }
    noise.forEach((each, i) => bounded(`observation_noise[${i}]`, each, 0, 10));
  } else bounded("observation_noise", noise, 0, 10);
  whole("action_delay", scene.action_delay, 0, data.latest, " (of steps)");
  if (scene.command !== null) scene.command = range("command", scene.command, 0, 1);
  whole("terrain_lookahead", scene.terrain_lookahead, 0, data.farthest);
  scene.terrain = terrainFrom(scene.terrain);
  if (scene.terrain_lookahead && scene.terrain === null) {
    throw new SceneError("terrain_lookahead shows footholds of a terrain: give one, or terrain_lookahead=0");
  }
  bounded("action_noise", scene.action_noise, 0, 1);
  bounded("command_weight", scene.command_weight, 0, 1e3);
  if (scene.start !== null) checkState(scene.start, "start");
  return scene;
}

function checkActions(scene, walker, data) {
  const actions = typeof scene.actions === "string" ? [scene.actions] : scene.actions;
  const strange = !Array.isArray(actions) || !actions.length ||
    actions.some((name) => !data.channels.includes(name)) || new Set(actions).size < actions.length;
  if (strange) {
    throw new SceneError(
      `actions must be some of ${data.channels.map(shown).join(", ")}, each once, not ${shown(scene.actions)}`,
    );
  }
  if (actions.includes("ankle") && walker.foot_radius !== 0) {
    throw new SceneError(
      "the action 'ankle' needs point feet: a round foot rolls, and the ground under it " +
        "bears no torque; choose a walker with foot_radius=0",
    );
  }
  scene.actions = actions;
}

function checkSeed(seed) {
  const whole = typeof seed === "bigint" || Number.isInteger(seed);
  if (!(whole && seed >= 0 && seed < 2 ** 64)) throw new SceneError(`seed must be a whole number from 0 to 2^64 - 1, not ${shown(seed)}`);
}

function checkState(state, name) {
  const row = Array.from(state ?? []);
  if (row.length !== 6 || !row.every((x) => typeof x === "number" && Number.isFinite(x))) {
    throw new SceneError(`${name} must be 6 finite numbers, angles and rates, not ${shown(state)}`);
  }
  return row;
}

const LEVEL = Object.freeze([0]);
const SMOOTH = { rises: LEVEL, slopes: LEVEL, repeats: true, height_std: 0, slope_std: 0 };
const TERRAINS = {
  rough: ["height_std", "slope_std"], stairs: ["rise"], waves: ["height", "strides"], footholds: ["heights", "slopes"],
};

/** A terrain as rises, slopes and standard deviations, from `{rough: {height_std: 0.002}}` and the like. */
export function terrainFrom(value) {
  if (value === null || value === undefined) return null;
  const number = (name, x, most) => {
    if (typeof x !== "number" || !(Math.abs(x) <= most)) {
      throw new SceneError(`terrain: ${name} must be a number from -${short(most)} to ${short(most)}, not ${shown(x)}`);
    }
    return x;
  };
  const row = (name, values, most) => {
    if (!Array.isArray(values)) throw new SceneError(`terrain: ${name} must be numbers in a row, not ${shown(values)}`);
    values.forEach((x) => number(name, x, most));
    return values;
  };
  if (typeof value === "object" && Object.hasOwn(value, "rises")) {
    const terrain = { ...SMOOTH, ...options(value, Object.keys(SMOOTH), "terrain") };
    row("rises", terrain.rises, 1e3);
    row("slopes", terrain.slopes, Math.PI / 2);
    number("height_std", terrain.height_std, 1e3);
    number("slope_std", terrain.slope_std, Math.PI / 2);
    if (terrain.rises.length !== terrain.slopes.length) {
      throw new SceneError(`${terrain.rises.length} rises for ${terrain.slopes.length} slopes of footholds`);
    }
    return room(terrain);
  }
  const [name, ...others] = typeof value === "object" ? Object.keys(value) : [];
  const known = entry(TERRAINS, name);
  if (!known || others.length) {
    throw new SceneError(
      "a terrain is null, or an object of one of rough, stairs, waves and footholds to its arguments, " +
        `as {"rough": {"height_std": 0.01}}, not ${shown(value)}`,
    );
  }
  const given = options(value[name], known, `terrain ${name}`);
  if (!Object.keys(given).length) throw new SceneError(`terrain ${name} needs ${known.join(" or ")}`);
  if (name === "rough") {
    const height_std = number("height_std", given.height_std ?? 0, 1e3);
    const slope_std = number("slope_std", given.slope_std ?? 0, Math.PI / 2);
    if (height_std < 0 || slope_std < 0) throw new SceneError("terrain rough: deviations must not be negative");
    return { ...SMOOTH, height_std, slope_std };
  }
  if (name === "stairs") return { ...SMOOTH, rises: [number("rise", given.rise, 1e3)] };
  if (name === "waves") {
    const count = whole("strides", given.strides, 2, FOOTHOLDS);
    const height = number("height", given.height, 1e3);
    const heights = Array.from({ length: count + 1 }, (_, i) => height * sine(((2 * Math.PI) / count) * i));
    const rises = heights.slice(1).map((x, i) => x - heights[i]);
    return { ...SMOOTH, rises, slopes: rises.map(() => 0) };
  }
  const level = Array((given.heights ?? given.slopes).length).fill(0);
  const heights = row("heights", given.heights ?? level, 1e3), slopes = row("slopes", given.slopes ?? level, Math.PI / 2);
  if (heights.length !== slopes.length) {
    throw new SceneError(`${heights.length} heights for ${slopes.length} slopes of footholds`);
  }
  const rises = [...heights.slice(1).map((x, i) => x - heights[i]), 0];
  return room({ ...SMOOTH, rises, slopes: [...slopes], repeats: false });
}

/** The nearest number to the sine of an angle from 0 to 7 rad; browsers have other bits in `Math.sin`. */
function sine(angle) {
  const bits = 160n, x = BigInt(angle * 2 ** 64) << (bits - 64n), square = (x * x) >> bits;
  let sum = 0n, term = x;
  for (let i = 2n; term; i += 2n) {
    sum += term;
    term = (-term * square) / ((i * (i + 1n)) << bits);
  }
  return Number(sum) * 2 ** -Number(bits);
}

function room(terrain) {
  if (!terrain.rises.length || terrain.rises.length > FOOTHOLDS) {
    throw new SceneError(`a terrain in a page has 1 to ${FOOTHOLDS} footholds, not ${terrain.rises.length}`);
  }
  return terrain;
}

// ---------------------------------------------------------------------------------------------
// Files and modules.

/** Reads the package's files beside this one: by fetch, or from the disk in Node. */
export async function readFile(name) {
  const place = new URL(name, import.meta.url);
  if (place.protocol === "file:") {
    const disk = await import(/* @vite-ignore */ "node:fs/promises");
    return disk.readFile(place);
  }
  const answer = await fetch(place);
  if (!answer.ok) throw new Error(`${name} cannot be read: ${answer.status} ${answer.statusText}`);
  return new Uint8Array(await answer.arrayBuffer());
}

const FILES = new WeakMap(); // by the function that reads them

function once(read, name, use) {
  const kept = FILES.get(read) ?? FILES.set(read, new Map()).get(read);
  if (!kept.has(name)) {
    const made = read(name).then(use);
    made.catch(() => kept.delete(name));
    kept.set(name, made);
  }
  return kept.get(name);
}

const parsed = (bytes) => JSON.parse(new TextDecoder().decode(bytes));

/** The walkers, gaits to start from, scenes and policies that come with the package. */
export function library(read = readFile) {
  return once(read, "data.json", parsed);
}

async function compiled(kind, read) {
  return once(read, `${kind}.wasm`, async (bytes) => {
    const module = await WebAssembly.compile(bytes);
    const [notes] = WebAssembly.Module.customSections(module, SECTION);
    return { module, notes: parsed(new Uint8Array(notes)) };
  });
}

/** The block of memory of one walker, and the compiled functions on it. */
class Block {
  constructor({ module, notes }) {
    const base = Math.ceil((notes.end + STACK) / 64) * 64;
    this.table = base + notes.size;
    this.scratch = this.table + 16 * FOOTHOLDS;
    const bytes = this.scratch + (notes.scratch ?? 0);
    const memory = new WebAssembly.Memory({ initial: Math.ceil(bytes / PAGE) });
    const env = {
      __linear_memory: memory,
      __indirect_function_table: new WebAssembly.Table({ initial: 1024, element: "anyfunc" }),
      __stack_pointer: new WebAssembly.Global({ value: "i32", mutable: true }, base),
    };
    this.notes = notes;
    this.base = base;
    this.bytes = new Uint8Array(memory.buffer);
    this.f8 = new Float64Array(memory.buffer);
    this.f4 = new Float32Array(memory.buffer);
    this.i4 = new Int32Array(memory.buffer);
    this.u8 = new BigUint64Array(memory.buffer);
    this.functions = new WebAssembly.Instance(module, { env }).exports;
  }

  at(name) {
    return this.base + this.notes.places[name][0];
  }

  get(name, i = 0) {
    const at = this.at(name);
    switch (this.notes.places[name][1]) {
      case "f8": return this.f8[at / 8 + i];
      case "f4": return this.f4[at / 4 + i];
      case "i8": return this.i4[at / 4 + 2 * i];
      default: return this.u8[at / 8 + i];
    }
  }

  set(name, value, i = 0) {
    const at = this.at(name);
    switch (this.notes.places[name][1]) {
      case "f8": this.f8[at / 8 + i] = value; break;
      case "f4": this.f4[at / 4 + i] = value; break;
      case "i8":
        this.i4[at / 4 + 2 * i] = Number(value);
        this.i4[at / 4 + 2 * i + 1] = value < 0 ? -1 : 0;
        break;
      default: this.u8[at / 8 + i] = BigInt(value);
    }
  }

  /** All entries of a field of numbers. */
  row(name) {
    const [, kind, count] = this.notes.places[name];
    const at = this.at(name);
    return kind === "f4" ? this.f4.subarray(at / 4, at / 4 + count) : this.f8.subarray(at / 8, at / 8 + count);
  }

  /** The bytes of a record. */
  record(name) {
    const at = this.at(name);
    return this.bytes.subarray(at, at + this.notes.places[name][2]);
  }

  /** Sets the engine's options; `fromSection` is for strides. */
  tolerate(tolerance, scuff, fromSection) {
    const known = this.notes.options, chosen = typeof tolerance === "number" && entry(known, short(tolerance));
    if (!chosen) throw new SceneError(`tolerance must be one of ${Object.keys(known).join(", ")}, not ${shown(tolerance)}`);
    ["tolerance", "landing", "doubt", "first_step", "fineness"].forEach((name, i) => this.set(`options.${name}`, chosen[i]));
    this.set("options.scuff", scuff ? 1 : 0);
    this.set("options.from_section", fromSection ? 1 : 0);
  }

  /** Sets the heights and slopes of footholds, and the deviations of random ones. */
  lay({ rises, slopes, repeats, height_std, slope_std }) {
    rises.forEach((rise, i) => this.f8.set([rise, slopes[i]], this.table / 8 + 2 * i));
    this.set("footholds", rises.length);
    [repeats ? 1 : 0, height_std, slope_std].forEach((x, i) => this.set("spread", x, i));
  }

  run(what) {
    this.functions.run(what, this.base);
  }
}

const ADVANCE = 0, BEGIN = 1, STEP = 2;

// ---------------------------------------------------------------------------------------------

/**
 * Makes a walker in a scene.
 *
 * @param walker A preset's name, an object of parameters, or null for the scene's own walker.
 * @param scene A scene's name or its arguments.
 * @param options `read` reads the package's files by name.
 */
export async function create(walker = null, scene = {}, others = {}) {
  const { read = readFile } = options(others, ["read"], "create");
  const data = await library(read), named = typeof scene === "string";
  const given = named ? entry(data.scenes, scene) : scene;
  if (named && !given) {
    throw new SceneError(`no scene ${shown(scene)}: give its arguments, or one of ${Object.keys(data.scenes).join(", ")}`);
  }
  if (given === null || typeof given !== "object" || Array.isArray(given)) {
    throw new SceneError(`no scene ${shown(scene)}: give its name or its arguments`);
  }
  const own = entry(given, "walker");
  if (!named && walker !== null && own !== undefined) {
    throw new SceneError("give the walker once: by itself, or in the scene");
  }
  const parameters = checkWalker(walker ?? own ?? "C", data);
  const module = await compiled(kindOf(parameters), read);
  return new PassiveWalker(data, module, parameters, checkScene(given, parameters, data));
}

/** A walker in a scene: an environment, its strides, and its picture. */
export class PassiveWalker {
  #block;
  #data;
  #origin = 0;
  #trace = [];
  #earlier = null;
  #impulse = 0;

  constructor(data, module, walker, scene) {
    this.#data = data;
    this.#block = new Block(module);
    this.#put(walker, scene);
    this.reset({ noise: false });
  }

  /** The walker's parameters. */
  get walker() {
    return { ...this.parameters };
  }

  /** Block of memory, for tests. */
  get block() {
    return this.#block;
  }

  /** sqrt(l/g), the unit of time. */
  get timeUnit() {
    return Math.sqrt(this.legLength / this.parameters.gravity);
  }

  get legLength() {
    return this.parameters.thigh_length + this.parameters.shank_length;
  }

  #put(walker, scene) {
    const block = this.#block, notes = block.notes, data = this.#data;
    this.parameters = walker;
    this.scene = scene;
    const extras = scene.actions.some((name) => name !== "hip") || FITTINGS.some((name) => walker[name] !== 0);
    const variant = scene.terrain !== null ? 2 : extras ? 1 : 0;
    data.parameters.forEach((name, i) => block.set("shape.parameters", walker[name], i));
    block.functions.body(block.at("shape"), block.at("bodies"));
    block.set("phases", block.functions.phases(variant));
    block.set("hooks", block.functions.hooks(variant));
    block.set("count", notes.locked.length);
    block.set("constants", notes.constants + notes.readings);
    block.set("radii", walker.foot_radius / this.legLength);
    this.seen = 8 + (scene.command !== null) + 2 * scene.terrain_lookahead;
    block.set("seen", this.seen);
    block.set("late", scene.action_delay);
    block.set("table", block.table);
    this.#putRules(scene);
    this.#putOdds(scene);
    block.tolerate(scene.tolerance, scene.end_on_toe_stub, false);
  }

  #putRules(scene) {
    const block = this.#block;
    for (const [name, row] of Object.entries(block.notes.rules)) row.forEach((x, i) => block.set(`rules.${name}`, x, i));
    block.set("rules.tick", scene.control === "tick" ? scene.tick : Infinity);
    block.set("rules.max_stride_time", scene.max_stride_time);
    block.set("rules.actions", scene.actions.length);
    this.#data.channels.forEach((name, i) => block.set("rules.largest", 0, i));
    scene.actions.forEach((name, i) => {
      const channel = this.#data.channels.indexOf(name);
      block.set("rules.channels", channel, i);
      block.set("rules.largest", scene[LARGEST[name]], channel);
    });
    block.set("rules.energy_weight", scene.energy_weight);
    block.set("rules.charged", this.#data.energies.indexOf(scene.energy));
    block.set("rules.step_limit", scene.step_limit);
  }

  #putOdds(scene) {
    const block = this.#block;
    block.set("settings.rate", scene.pushes.rate ?? 0);
    (scene.pushes.impulse ?? [0, 0]).forEach((x, i) => block.set("settings.push", x, i));
    const noise = scene.observation_noise;
    const each = Array.isArray(noise) ? noise : [...Array(6).fill(noise), 0, 0];
    each.forEach((x, i) => block.set("settings.noise", x, i));
    block.set("settings.noisy", each.some((x) => x > 0) ? 1 : 0);
    block.set("settings.action_noise", scene.action_noise);
    block.set("settings.commanded", scene.command === null ? 0 : 1);
    (scene.command ?? [0, 0]).forEach((x, i) => block.set("settings.command", x, i));
    block.set("settings.command_weight", scene.command_weight);
    block.set("settings.uneven", scene.terrain === null ? 0 : 1);
    block.set("settings.terrain_lookahead", scene.terrain_lookahead);
    block.set("settings.interval", Infinity);
    block.set("settings.friction", this.#data.friction);
    block.lay(scene.terrain ?? SMOOTH);
  }

  /** The state to start from at a slope: the scene's start, or between known gaits of the presets. */
  startingState(slope = this.slope) {
    if (this.scene.start !== null) return [...this.scene.start];
    const kind = kindOf(this.parameters);
    const like = Object.values(this.#data.walkers).filter((w) => w.kind === kind && w.gaits.length);
    const own = like.map((w) => [this.#distance(w.parameters), w]).sort((a, b) => a[0] - b[0]);
    const { gaits } = own[0][1];
    if (slope <= 0) return [...(gaits.find(([s]) => s === 0.01) ?? gaits[0])[1]];
    const right = Math.min(Math.max(gaits.findIndex(([s]) => s >= slope), 1), gaits.length - 1);
    const [[a, low], [b, high]] = gaits.length > 1 ? [gaits[right - 1], gaits[right]] : [gaits[0], gaits[0]];
    if (slope === b || a === b) return [...high];
    const share = Math.min(Math.max((slope - a) / (b - a), 0), 1);
    return low.map((x, i) => (1 - share) * x + share * high[i]);
  }

  #distance(other) {
    const own = this.parameters;
    return this.#data.parameters.reduce((sum, name) => {
      const size = Math.max(Math.abs(own[name]), Math.abs(other[name]));
      return size ? sum + Math.abs(own[name] - other[name]) / size : sum;
    }, 0);
  }

  /**
   * Begins an episode and returns the first observation.
   *
   * @param options `seed` is the walker's key: a whole number below 2^64; `state` is a state on the
   *   Poincaré section to start from exactly, angular velocities in sqrt(g/l); `slope` in rad is
   *   that of this episode, instead of the scene's; `noise: false` starts without the scene's reset
   *   noise.
   */
  reset(others = {}) {
    const { seed = 0, state = null, slope = null, noise = true } = options(others, ["seed", "state", "slope", "noise"], "reset");
    const block = this.#block;
    checkSeed(seed);
    if (typeof noise !== "boolean") throw new SceneError(`noise must be True or False, not ${shown(noise)}`);
    if (slope !== null && !(Math.abs(slope) < Math.PI / 2)) {
      throw new SceneError(`slope must be an angle in rad between -pi/2 and pi/2, not ${shown(slope)}`);
    }
    const angle = slope ?? this.scene.slope;
    const given = state === null ? this.startingState(angle) : checkState(state, "state");
    this.slope = angle;
    this.#impulse = 0;
    block.set("key", BigInt.asUintN(64, BigInt(seed)));
    block.set("lanes", 0);
    block.set("slopes", angle);
    given.forEach((x, i) => block.set("gaits", x, i));
    const drawn = noise && state === null;
    block.set("drawn", drawn ? 1 : 0);
    if (!drawn) for (let i = 0; i < 4; i++) block.set("draws", 0.5, i);
    block.set("rules.reset_noise_scale", this.scene.reset_noise_scale);
    block.run(BEGIN);
    block.record("before").set(block.record("record"));
    this.#origin = 0;
    this.#trace = [];
    this.#contact();
    this.#earlier = this.#here();
    this.duration = 0;
    return this.observation;
  }

  get observation() {
    return Float32Array.from(this.#block.row("observations").subarray(0, this.seen));
  }

  /** Whether the episode is over. */
  get over() {
    return this.#block.get("ledger.ending") !== 0 || this.#block.get("ledger.truncated") !== 0;
  }

  /** How the last stride or episode ended: a name of Python's `Outcome`, or null. */
  get outcome() {
    const outcome = this.#block.get("ledger.outcome");
    return outcome ? this.#data.outcomes[outcome] : null;
  }

  /** Takes a control step; after the end of the episode the walker rests. */
  step(action = null) {
    const block = this.#block;
    const given = Array.from(action ?? Array(this.scene.actions.length).fill(0));
    if (given.length !== this.scene.actions.length || !given.every((x) => Number.isFinite(x))) {
      throw new SceneError(`an action must be ${this.scene.actions.length} finite numbers, not ${shown(action)}`);
    }
    given.forEach((x, i) => block.set("actions", x, i));
    if (this.#impulse) {
      block.set("disturbance.known", this.#impulse);
      block.set("disturbance.due", this.time);
      this.#impulse = 0;
    }
    block.record("before").set(block.record("record"));
    const before = block.get("record.time");
    this.#earlier = this.#here();
    block.run(STEP);
    const terminated = block.bytes[block.at("terminated")] !== 0;
    const truncated = block.bytes[block.at("truncated")] !== 0;
    const struck = this.outcome === "HEELSTRIKE";
    this.duration = (struck ? block.get("ledger.step_period") : block.get("record.time")) - before;
    this.#contact();
    return { observation: this.observation, reward: block.get("rewards"), terminated, truncated, info: this.info };
  }

  /** Measures of the last step, by the names of Python's `info`. */
  get info() {
    const block = this.#block, info = {};
    for (const name of this.#data.every_step) info[name] = block.get(`ledger.${name}`);
    if (this.outcome) {
      info.outcome = this.outcome;
      for (const name of this.#data.every_stride) info[name] = block.get(`ledger.${name}`);
    }
    return info;
  }

  /** Walks on to the next heelstrike or the end of the episode by one held action. */
  stride(action = null) {
    const steps = [];
    let last;
    do {
      last = this.step(action);
      steps.push(last);
    } while (!this.over && last.info.outcome !== "HEELSTRIKE" && steps.length < 100000);
    return { ...last.info, state: this.state, steps: steps.length };
  }

  /**
   * The stride map: one stride from a state on the Poincaré section under held torques.
   *
   * The walk of this object stays as it is. All numbers are dimensionless, see the documentation's
   * page on theory.
   *
   * @param state Angles of stance leg, thigh and shank in rad, then their angular velocities.
   * @param options `slope`, `hip_torque`, `ankle_torque`, `push_off`, `height_change`, `slope_change`.
   */
  strideFrom(state, others = {}) {
    const usual = {
      slope: this.slope, hip_torque: 0, ankle_torque: 0, push_off: 0, height_change: 0, slope_change: 0, tolerance: 1e-12,
    };
    const given = { ...usual, ...options(others, Object.keys(usual), "strideFrom") };
    for (const [name, value] of Object.entries(given)) finite(name, value);
    const { slope, hip_torque, ankle_torque, push_off, height_change, slope_change, tolerance } = given;
    const block = this.#block, kept = block.bytes.slice(block.base, block.table);
    try {
      const row = checkState(state, "state");
      if (!this.parameters.knees) [row[2], row[5]] = [row[1], row[4]];
      row.forEach((x, i) => block.set("gaits", x, i));
      block.set("slopes", slope);
      block.set("drawn", 0);
      for (let i = 0; i < 4; i++) block.set("draws", 0.5, i);
      block.set("settings.uneven", 0);
      block.run(BEGIN);
      const extras = ankle_torque || push_off || FITTINGS.some((name) => this.parameters[name] !== 0);
      const variant = height_change || slope_change ? 2 : extras ? 1 : 0;
      block.set("phases", block.functions.phases(variant));
      block.set("record.ground", height_change, 2);
      block.set("record.ground", slope_change, 3);
      block.set("record.control", hip_torque, 0);
      block.set("record.control", ankle_torque, 1);
      block.set("record.push_off", push_off);
      block.set("record.end", 100);
      block.set("record.place", 0);
      block.tolerate(tolerance, false, true);
      block.run(ADVANCE);
      return this.#record();
    } finally {
      block.bytes.set(kept, block.base);
    }
  }

  #record() {
    const block = this.#block;
    const outcome = block.get("record.outcome");
    const names = [
      "step_length", "gravity_work", "spring_work", "push_work", "knee_time", "knee_loss", "heel_loss",
      "friction_loss",
    ];
    return {
      outcome: this.#data.outcomes[outcome || this.#data.outcomes.indexOf("STALLED")],
      state: Array.from(block.row("record.state")),
      duration: block.get("record.time"),
      ...Object.fromEntries(names.map((name) => [name, block.get(`record.${name}`)])),
    };
  }

  /** Angles of stance leg, thigh and shank in rad, then their angular velocities in sqrt(g/l). */
  get state() {
    return Array.from(this.#block.row("record.state"));
  }

  /** Time since the stride began, in sqrt(l/g). */
  get time() {
    return this.#block.get("record.time");
  }

  get strides() {
    return this.#block.get("ledger.strides");
  }

  /** Whether the swing leg's knee is free. */
  get kneeFree() {
    return !this.#block.notes.locked[this.#block.get("record.phase")];
  }

  /** Pushes the hip when the next control step begins: an impulse in m sqrt(g l), positive downhill; pushes add. */
  push(impulse) {
    if (!Number.isFinite(impulse) || Math.abs(impulse) > 10) {
      throw new SceneError(`impulse must be a number from -10 to 10, not ${shown(impulse)}`);
    }
    if (!this.over) this.#impulse += impulse;
  }

  /**
   * Changes the walker or the scene; angles and angular velocities stay.
   *
   * A walker of another kind needs another module: create a new object for it. The number of
   * actions and observations must stay.
   */
  change(others = {}) {
    const { walker = null, scene = {} } = options(others, ["walker", "scene"], "change");
    options(scene, [...Object.keys(SCENE), ...this.#data.in_python], "a scene");
    const block = this.#block;
    const parameters = walker === null ? this.parameters : checkWalker(walker, this.#data);
    if (kindOf(parameters) !== block.notes.kind) {
      throw new WalkerError(`this walker is ${kindOf(parameters)} and the module is for ${block.notes.kind} ones: create another`);
    }
    const next = checkScene({ ...this.scene, ...scene }, parameters, this.#data);
    const before = this.timeUnit, contact = this.contact, length = this.legLength;
    this.#put(parameters, next);
    const slower = before / this.timeUnit;
    for (let i = 3; i < 6; i++) block.set("record.state", block.get("record.state", i) / slower, i);
    for (const name of ["time", "step", "knee_time"]) block.set(`record.${name}`, block.get(`record.${name}`) * slower);
    if (entry(scene, "slope") !== undefined) this.slope = next.slope;
    if (block.get("ledger.slope") !== this.slope + block.get("disturbance.tilt")) this.#lean();
    this.#origin = contact - (block.get("disturbance.x") * this.legLength) - this.#rolled();
    if (length !== this.legLength) this.#trace = [];
  }

  /** Continues on another slope. */
  #lean() {
    const { slope } = this, block = this.#block, kept = block.bytes.slice(block.base, block.table);
    block.set("slopes", slope + block.get("disturbance.tilt"));
    block.set("settings.uneven", 0);
    block.run(BEGIN);
    const ground = [block.get("record.ground", 0), block.get("record.ground", 1)];
    block.bytes.set(kept, block.base);
    ground.forEach((x, i) => block.set("record.ground", x, i));
    block.set("ledger.slope", slope + block.get("disturbance.tilt"));
    block.set("disturbance.slope", slope);
  }

  #rolled() {
    const start = this.#block.get("record.start"), stance = this.#block.get("record.state");
    return this.parameters.foot_radius * (start - stance);
  }

  /** Records where strides begin, if there is no terrain to do it. */
  #contact() {
    const block = this.#block;
    const strides = this.strides;
    if (this.#trace.length && this.#trace[this.#trace.length - 1].strides === strides) return;
    if (this.scene.terrain === null && strides && this.#trace.length) {
      this.#origin += block.get("ledger.step_length") * this.legLength;
    }
    this.#trace.push({ strides, x: this.#origin + block.get("disturbance.x") * this.legLength, y: block.get("disturbance.y") * this.legLength });
    if (this.#trace.length > 12) this.#trace.shift();
  }

  /** Position of the contact point along the slope, in the walker's units of length. */
  get contact() {
    return this.#origin + this.#block.get("disturbance.x") * this.legLength + this.#rolled();
  }

  /** Contact points at which the last strides began, in the walker's units of length. */
  get footholds() {
    return this.#trace.map((each) => ({ ...each }));
  }

  /** Where the stride began, and on what. */
  #here() {
    const block = this.#block, l = this.legLength;
    return {
      x: this.#origin + block.get("disturbance.x") * l,
      y: block.get("disturbance.y") * l,
      tilt: block.get("disturbance.tilt"),
      start: block.get("record.start"),
      strides: this.strides,
    };
  }

  /** Positions of the joints, (x, y) in the walker's units: x along the slope from the start. */
  joints(state = this.state) {
    return this.#placed(checkState(state, "state"), this.#here());
  }

  #placed(state, { x, y, tilt, start }) {
    const block = this.#block;
    const angles = state.slice(0, 3).map((angle) => angle - tilt);
    if (!this.parameters.knees) angles[2] = angles[1];
    angles.forEach((angle, i) => block.set("shape.angles", angle, i));
    block.set("shape.tilt", tilt);
    block.functions.joints(block.at("shape"), block.at("points"));
    const rolled = this.parameters.foot_radius * (start - state[0]);
    const contact = [x + rolled * Math.cos(tilt), y - rolled * Math.sin(tilt)];
    const found = { contact, stance: angles[0], shank: angles[2] };
    block.notes.points.forEach((name, i) => {
      found[name] = [contact[0] + block.get("points", 2 * i), contact[1] + block.get("points", 2 * i + 1)];
    });
    return found;
  }

  /** The walker now, for a picture. */
  frame() {
    const state = this.state;
    return { state, strides: this.strides, joints: this.#placed(state, this.#here()) };
  }

  /**
   * The walker within the last control step, at a share from 0 to 1 of it, for a picture.
   *
   * The engine integrates the step again up to there, so the frame is as exact as the step's end. A
   * step with a push has no frame but its end.
   */
  within(share) {
    const block = this.#block;
    if (share >= 1 || !(this.duration > 0) || block.get("disturbance.impulse") !== 0) return this.frame();
    const kept = block.bytes.slice(block.base, block.table);
    try {
      const names = ["record.control", "record.control", "record.push_off"];
      const held = names.map((name, i) => block.get(name, i % 2));
      block.record("record").set(block.record("before"));
      names.forEach((name, i) => block.set(name, held[i], i % 2));
      block.set("record.end", block.get("record.time") + Math.max(share * this.duration, 1e-9));
      block.run(ADVANCE);
      const state = Array.from(block.row("record.state"));
      return { state, strides: this.#earlier.strides, joints: this.#placed(state, this.#earlier) };
    } finally {
      block.bytes.set(kept, block.base);
    }
  }

  /**
   * Searches for the periodic gait near a state by Newton's method, with finite differences.
   *
   * Returns its state, its Floquet multipliers [re, im] and its stride; null if none is found.
   */
  findGait(others = {}) {
    const { guess = null, hip_torque = 0, slope = this.slope, tries = 30 } =
      options(others, ["guess", "hip_torque", "slope", "tries"], "findGait");
    whole("tries", tries, 1, 1e6);
    const size = this.parameters.knees ? 4 : 3;
    const free = [0, 3, 4, 5].slice(0, size);
    const of = (point) => [point[0], -point[0], -point[0], point[1], point[2], point[size - 1]];
    const map = (point) => {
      const found = this.strideFrom(of(point), { slope, hip_torque });
      return found.outcome === "HEELSTRIKE" ? { point: free.map((i) => found.state[i]), found } : null;
    };
    const start = guess === null ? this.startingState(slope) : checkState(guess, "guess");
    const gait = fixedPoint(map, free.map((i) => start[i]), tries);
    return gait && { state: of(gait.point), multipliers: gait.multipliers, stride: gait.end.found };
  }

  /**
   * Draws the walker and its ground on a canvas.
   *
   * @param options `colors` by name, `frame` instead of the present one, `width` in leg lengths.
   */
  render(canvas, others = {}) {
    const { colors = {}, frame = this.frame(), width = 3.2, push = null } = options(others, DRAWN, "render");
    draw(this, canvas, { ...COLORS, ...options(colors, Object.keys(COLORS), "colors") }, frame, width, push);
  }
}

/** A fixed point of a map by Newton's method with finite differences, and its multipliers; or null. */
function fixedPoint(map, start, tries) {
  let point = [...start];
  for (let i = 0; i < tries; i++) {
    const here = map(point);
    if (!here) return null;
    const matrix = jacobian(map, point);
    if (!matrix) return null;
    const residual = here.point.map((x, k) => x - point[k]);
    const change = solve(matrix.map((row, r) => row.map((x, c) => x - (r === c ? 1 : 0))), residual.map((x) => -x));
    if (!change) return null;
    const length = Math.max(...change.map(Math.abs));
    // Shares count from the first: a nearly singular matrix asks for steps of any length.
    const first = Math.min(1, 0.05 / length);
    let next = null;
    for (let share = first; share > 1e-3 * first && !next; share /= 2) {
      const tried = point.map((x, k) => x + share * change[k]);
      if (map(tried)) next = tried;
    }
    if (!next) return null;
    point = next;
    if (length < 1e-11) {
      const end = map(point), last = end && jacobian(map, point);
      return last && { point, multipliers: eigenvalues(last), end };
    }
  }
  return null;
}

function jacobian(map, point) {
  const columns = point.map((_, k) => {
    const h = 1e-6;
    const [up, down] = [h, -h].map((d) => map(point.map((x, i) => (i === k ? x + d : x))));
    return up && down ? up.point.map((x, i) => (x - down.point[i]) / (2 * h)) : null;
  });
  if (columns.includes(null)) return null;
  return point.map((_, r) => columns.map((column) => column[r]));
}

/** Solves a small linear system by elimination; null if it is singular. */
function solve(matrix, right) {
  const rows = matrix.map((row, i) => [...row, right[i]]);
  const n = rows.length;
  for (let k = 0; k < n; k++) {
    const best = rows.slice(k).reduce((b, row, i) => (Math.abs(row[k]) > Math.abs(rows[b][k]) ? k + i : b), k);
    [rows[k], rows[best]] = [rows[best], rows[k]];
    if (!(Math.abs(rows[k][k]) > 1e-14)) return null;
    for (let i = 0; i < n; i++) {
      if (i === k) continue;
      const factor = rows[i][k] / rows[k][k];
      for (let j = k; j <= n; j++) rows[i][j] -= factor * rows[k][j];
    }
  }
  return rows.map((row, i) => row[n] / row[i]);
}

/** Eigenvalues [re, im] of a small matrix by the QR method with Wilkinson's shifts. */
function eigenvalues(matrix) {
  const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
  const root = ([a, b]) => {
    const size = Math.hypot(a, b), re = Math.sqrt((size + Math.abs(a)) / 2);
    if (!re) return [0, 0];
    return a >= 0 ? [re, b / (2 * re)] : [Math.abs(b) / (2 * re), b < 0 ? -re : re];
  };
  const norm = Math.max(...matrix.flat().map(Math.abs)) || 1, found = [];
  let rows = matrix.map((row) => row.map((x) => [x, 0]));
  for (let tries = 0; rows.length; tries++) {
    const n = rows.length - 1, [corner, last] = [rows[n][n], rows[n].slice(0, n)];
    if (tries > 500 || last.every(([x, y]) => Math.hypot(x, y) < 1e-15 * norm)) {
      found.push(corner);
      rows = rows.slice(0, n).map((row) => row.slice(0, n));
      tries = 0;
      continue;
    }
    // The eigenvalue of the last two rows and columns that is nearer to the corner.
    const before = rows[n - 1][n - 1], half = [(before[0] - corner[0]) / 2, (before[1] - corner[1]) / 2];
    const square = times(half, half), product = times(rows[n - 1][n], rows[n][n - 1]);
    const [x, y] = root([square[0] + product[0], square[1] + product[1]]);
    const sign = half[0] * x + half[1] * y > 0 ? -1 : 1;
    const exceptional = tries % 11 === 10 ? norm : 0;
    const shift = [corner[0] + half[0] + sign * x + exceptional, corner[1] + half[1] + sign * y];
    rows = turned(rows, shift, times);
  }
  return found.map(([re, im]) => [re, Math.abs(im) < 1e-9 * (1 + Math.abs(re)) ? 0 : im]);
}

/** RQ + shift, where QR is a complex matrix less the shift; by Givens rotations. */
function turned(rows, [re, im], times) {
  const n = rows.length, a = rows.map((row, i) => row.map(([x, y], j) => (i === j ? [x - re, y - im] : [x, y]))), turns = [];
  const conjugate = ([x, y]) => [x, -y], plus = ([p, q], [x, y]) => [p + x, q + y];
  for (let j = 0; j < n; j++) {
    for (let i = j + 1; i < n; i++) {
      const size = Math.hypot(...a[j][j], ...a[i][j]);
      if (!Math.hypot(...a[i][j])) continue;
      const c = a[j][j].map((x) => x / size), s = a[i][j].map((x) => x / size);
      turns.push([j, i, c, s]);
      for (let k = 0; k < n; k++) {
        const [p, q] = [a[j][k], a[i][k]];
        a[j][k] = plus(times(conjugate(c), p), times(conjugate(s), q));
        a[i][k] = plus(times([-s[0], -s[1]], p), times(c, q));
      }
    }
  }
  for (const [j, i, c, s] of turns) {
    for (let k = 0; k < n; k++) {
      const [p, q] = [a[k][j], a[k][i]];
      a[k][j] = plus(times(p, c), times(q, s));
      a[k][i] = plus(times(p, conjugate([-s[0], -s[1]])), times(q, conjugate(c)));
    }
  }
  return a.map((row, i) => row.map(([x, y], j) => (i === j ? [x + re, y + im] : [x, y])));
}

const COLORS = {
  background: "#ffffff", ground: "#4b5563", mark: "#6b7280", even: "#1f5fa8", odd: "#a8480f",
  body: "#374151", push: "#b91c1c",
};
const DRAWN = ["colors", "frame", "width", "push"];

function draw(walk, canvas, colors, { joints, strides }, width, push) {
  const context = canvas.getContext("2d");
  const l = walk.legLength, { slope } = walk;
  const scale = canvas.width / (width * l);
  const middle = joints.hip[0], place = placeOn(canvas, slope, [middle, 0], scale);
  context.fillStyle = colors.background;
  context.fillRect(0, 0, canvas.width, canvas.height);
  drawGround(context, place, middle, width * l, colors, scale, l, walk.scene.terrain && walk.footholds);
  const odd = strides % 2 === 1;
  const legs = [
    ["swing", odd ? colors.even : colors.odd, joints.shank],
    ["stance", odd ? colors.odd : colors.even, joints.stance],
  ];
  for (const [name, color, angle] of legs) drawLeg(walk, context, place, joints, name, color, angle, scale, slope);
  const [x, y] = place(joints.hip);
  context.fillStyle = colors.body;
  context.beginPath();
  context.arc(x, y, 0.045 * l * scale, 0, 2 * Math.PI);
  context.fill();
  if (push) drawPush(context, [x, y], push, colors.push, scale * l);
}

/** Turns positions along a slope into those of a canvas, with one of them in its middle. */
function placeOn(canvas, slope, middle, scale) {
  const sine = Math.sin(slope), cosine = Math.cos(slope);
  return (point) => {
    const x = point[0] - middle[0], y = point[1] - middle[1];
    return [canvas.width / 2 + (x * cosine + y * sine) * scale, canvas.height * 0.86 - (y * cosine - x * sine) * scale];
  };
}

/** Draws smooth ground, or footholds; marks are a leg's length `l` apart. */
function drawGround(context, place, middle, span, colors, scale, l, holds) {
  const reach = span;
  context.strokeStyle = colors.ground;
  context.lineWidth = Math.max(1, 0.006 * scale * l);
  context.beginPath();
  if (!holds) {
    context.moveTo(...place([middle - reach, 0]));
    context.lineTo(...place([middle + reach, 0]));
  } else {
    for (const { x, y } of holds) {
      context.moveTo(...place([x - 0.12 * l, y]));
      context.lineTo(...place([x + 0.12 * l, y]));
    }
  }
  context.stroke();
  context.fillStyle = colors.mark;
  const first = Math.ceil((middle - reach) / l), last = Math.floor((middle + reach) / l);
  context.font = `${Math.max(10, Math.round(0.06 * scale * l))}px system-ui, sans-serif`;
  context.textAlign = "center";
  for (let i = first; i <= last; i++) {
    const [x, y] = place([i * l, 0]);
    context.fillRect(x - 0.5, y + 3, 1, 0.03 * scale * l);
    context.fillText(String(i), x, y + 0.11 * scale * l);
  }
}

function drawLeg(walk, context, place, joints, name, color, angle, scale, slope) {
  const points = [joints.hip, joints[`${name}_knee`], joints[`${name}_foot`], joints[`${name}_tip`]];
  context.strokeStyle = context.fillStyle = color;
  context.lineCap = context.lineJoin = "round";
  context.lineWidth = 0.035 * walk.legLength * scale;
  context.beginPath();
  points.forEach((point, i) => (i ? context.lineTo(...place(point)) : context.moveTo(...place(point))));
  context.stroke();
  const radius = walk.parameters.foot_radius * scale;
  if (radius > 0) {
    const [x, y] = place(points[2]);
    // The middle of the sole lies on the shank's line; angles of a canvas turn clockwise.
    const down = Math.PI / 2 + slope - angle;
    context.beginPath();
    context.arc(x, y, radius, down - SOLE_SPAN, down + SOLE_SPAN);
    context.stroke();
  }
  if (walk.parameters.knees) {
    const [x, y] = place(points[1]);
    context.beginPath();
    context.arc(x, y, 0.03 * walk.legLength * scale, 0, 2 * Math.PI);
    context.fill();
  }
}

function drawPush(context, [x, y], push, color, length) {
  const end = x + push * 8 * length;
  context.strokeStyle = context.fillStyle = color;
  context.lineWidth = 3;
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(end, y);
  context.stroke();
  context.beginPath();
  context.moveTo(end + Math.sign(push) * 10, y);
  context.lineTo(end, y - 6);
  context.lineTo(end, y + 6);
  context.fill();
}

// ---------------------------------------------------------------------------------------------
// Trained policies: a small network. Sums are in single precision, as in Python, in another order.

const ACTIVATIONS = {
  ReLU: (x) => Math.max(x, 0),
  Tanh: Math.tanh,
  ELU: (x) => (x > 0 ? x : Math.expm1(x)),
  SiLU: (x) => x * (0.5 * (1 + Math.tanh(0.5 * x))),
};
const HIDDEN = { sac: ["actor.latent_pi", "actor.mu"] };

function tensorsOf(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const size = Number(view.getBigUint64(0, true));
  const header = parsed(bytes.subarray(8, 8 + size));
  const tensors = Object.create(null);
  for (const [name, { dtype, shape, data_offsets: [first, end] }] of Object.entries(header)) {
    if (name === "__metadata__") continue;
    const raw = bytes.slice(8 + size + first, 8 + size + end).buffer;
    tensors[name] = { shape, values: dtype === "F64" ? new Float64Array(raw) : new Float32Array(raw) };
  }
  return tensors;
}

/** A trained policy that comes with the package, and the scene that it was trained for. */
export async function loadPolicy(name, others = {}) {
  const { read = readFile } = options(others, ["read"], "loadPolicy");
  const data = await library(read), found = entry(data.policies, name);
  if (!found) {
    throw new Error(`no policy ${shown(name)}: choose from ${Object.keys(data.policies).join(", ")}`);
  }
  const { algo, activation, normalizer, scene } = found;
  const tensors = tensorsOf(new Uint8Array(await once(read, `policies/${name}.safetensors`, (bytes) => bytes)));
  const [hidden, mean] = entry(HIDDEN, algo) ?? ["mlp_extractor.policy_net", "action_net"];
  const places = [...new Set(Object.keys(tensors).filter((key) => key.startsWith(`${hidden}.`)).map((key) => key.replace(/\.\w+$/, "")))];
  places.sort((a, b) => Number(a.split(".").pop()) - Number(b.split(".").pop()));
  const layer = (place) => [tensors[`${place}.weight`], tensors[`${place}.bias`]];
  const layers = [...places.map(layer), layer(mean)];
  const activate = entry(ACTIVATIONS, activation), size = layers[0][0].shape[1];
  if (!activate) throw new Error(`policy ${shown(name)} has an unknown activation function, ${shown(activation)}`);
  const moments = normalizer && {
    mean: tensors["normalizer.obs_rms.mean"].values,
    spread: Array.from(tensors["normalizer.obs_rms.var"].values, (x) => Math.sqrt(x + normalizer.epsilon)),
  };
  const predict = (observation) => {
    if (observation?.length !== size) {
      throw new SceneError(`an observation of policy ${shown(name)} has ${size} numbers, not ${observation?.length ?? shown(observation)}`);
    }
    let x = Float32Array.from(observation, (value, i) => {
      if (!moments) return value;
      const scaled = (value - moments.mean[i]) / moments.spread[i];
      return Math.min(Math.max(scaled, -normalizer.clip), normalizer.clip);
    });
    layers.forEach(([weight, bias], k) => {
      const [rows, columns] = weight.shape;
      const next = new Float32Array(rows);
      for (let i = 0; i < rows; i++) {
        let sum = 0;
        for (let j = 0; j < columns; j++) sum += weight.values[i * columns + j] * x[j];
        next[i] = k < layers.length - 1 ? activate(Math.fround(sum + bias.values[i])) : sum + bias.values[i];
      }
      x = next;
    });
    return Array.from(x, (value) => (algo === "sac" ? Math.tanh(value) : Math.min(Math.max(value, -1), 1)));
  };
  return { name, scene, predict };
}

// ---------------------------------------------------------------------------------------------
// Systems of one's own, compiled by Python's `web.build(folder, systems)`.

/**
 * Makes a walker of a system of one's own.
 *
 * @param name The system's name in `web.build`, as "torso".
 * @param options `slope` in rad, `body` with other values of its fields, `state` to start from,
 *   `terrain` of different heights, `seed` of random footholds, `tolerance`, and `read`, which reads
 *   the package's files by name.
 */
export async function createSystem(name, others = {}) {
  const { read = readFile, ...rest } = options(others, ["read", ...OF_SYSTEM], "createSystem");
  if (typeof name !== "string" || !/^[\p{L}\p{N}_-]+$/u.test(name)) {
    throw new SceneError(`no system ${shown(name)}: give a name of web.build, of letters, digits, '-' and '_'`);
  }
  return new SystemWalker(await compiled(`systems/${name}`, read), rest);
}

const OF_SYSTEM = ["slope", "body", "state", "terrain", "seed", "tolerance"];

const LAY_GROUND = 1, PUSH = 2; // what a system's module runs besides ADVANCE

/** A system of one's own: its stride map, a walk under held controls, and its picture. */
export class SystemWalker {
  #block;
  #trace = [];
  #earlier = null;
  #impulse = 0;
  #height = 1;

  constructor(module, others = {}) {
    const { slope = module.notes.slope, body = {}, state = null, terrain = null, seed = 0, tolerance = 1e-8 } =
      options(others, OF_SYSTEM, "a system");
    const block = (this.#block = new Block(module)), { notes } = block;
    this.name = notes.system;
    this.fields = { ...notes.body };
    this.controls = notes.controls;
    this.terrain = this.#checkTerrain(terrain);
    this.#choose(this.terrain !== null);
    block.set("count", notes.locked.length);
    block.set("bodies", block.scratch);
    block.set("constants", Object.keys(notes.body).length);
    block.set("table", block.table);
    block.tolerate(tolerance, false, true);
    this.change({ slope, body });
    this.reset(state, { seed });
  }

  /** Block of memory, for tests. */
  get block() {
    return this.#block;
  }

  /** sqrt(l/g) in s, the unit of time, if the unit of length is 1 m. */
  get timeUnit() {
    return 1 / Math.sqrt(9.81);
  }

  get #size() {
    return this.#block.notes.state.length;
  }

  /** Chooses the equations for even or uneven ground. */
  #choose(uneven) {
    const block = this.#block;
    block.set("phases", block.functions.phases(uneven ? 1 : 0));
    block.set("hooks", block.functions.hooks(uneven ? 1 : 0));
  }

  #even() {
    if (!this.#block.notes.uneven) throw new SceneError(`the equations of ${this.name} are for even ground`);
  }

  #checkTerrain(value) {
    const terrain = terrainFrom(value);
    if (terrain === null) return null;
    this.#even();
    if (terrain.slope_std || terrain.slopes.some((x) => x !== 0)) {
      throw new SceneError("footholds of a system may differ in height, not in slope");
    }
    return terrain;
  }

  /** Changes fields of the body and the slope; coordinates and their rates stay. */
  change(others = {}) {
    const { slope = this.slope, body = {} } = options(others, ["slope", "body"], "change");
    const block = this.#block;
    if (!(typeof slope === "number" && Math.abs(slope) < Math.PI / 2)) {
      throw new SceneError(`slope must be an angle in rad between -pi/2 and pi/2, not ${shown(slope)}`);
    }
    const own = options(body, Object.keys(this.fields), `the body of ${this.name}`);
    for (const [name, value] of Object.entries(own)) finite(name, value);
    this.slope = slope;
    this.fields = { ...this.fields, ...own };
    Object.values(this.fields).forEach((value, i) => (block.f8[block.scratch / 8 + i] = value));
    this.#ground(this.terrain, this.strides);
  }

  /** Sets the ground of a stride; the compiled code has Python's sine. */
  #ground(terrain, strides, slope = this.slope) {
    const block = this.#block;
    block.lay(terrain ?? SMOOTH);
    block.set("strides", strides ?? 0);
    block.set("slope", slope);
    block.run(LAY_GROUND);
  }

  /** The height of the next foothold over this one. */
  get rise() {
    return this.#block.get("record.ground", 2);
  }

  #put(state) {
    const block = this.#block, { room } = block.notes, half = this.#size / 2, row = Array.from(state ?? []);
    if (row.length !== this.#size || !row.every(Number.isFinite)) {
      throw new SceneError(`state must be ${this.#size} finite numbers, not ${shown(state)}`);
    }
    block.record("record").fill(0);
    row.forEach((x, i) => block.set("record.state", x, i < half ? i : room + i - half));
  }

  #hold(controls) {
    const given = Array.from(controls ?? Array(this.controls.length).fill(0));
    if (given.length !== this.controls.length || !given.every(Number.isFinite)) {
      throw new SceneError(`controls must be ${this.controls.length} finite numbers, not ${shown(controls)}`);
    }
    given.forEach((x, i) => this.#block.set("record.control", x, i));
  }

  #advance(end, fromSection) {
    const block = this.#block;
    block.set("record.end", end);
    block.set("options.from_section", fromSection ? 1 : 0);
    block.run(ADVANCE);
  }

  /** Begins again just after a heelstrike; without a state, at the system's start. */
  reset(state = null, others = {}) {
    const { seed = 0 } = options(others, ["seed"], "reset");
    checkSeed(seed);
    const block = this.#block, { notes } = block;
    this.#put(state ?? notes.start ?? Array(this.#size).fill(0));
    block.set("key", BigInt.asUintN(64, BigInt(seed)));
    this.strides = 0;
    this.#ground(this.terrain, 0);
    this.#trace = [{ strides: 0, x: 0, y: 0 }];
    this.#impulse = 0;
    this.duration = 0;
    this.fresh = true;
    this.outcome = null;
    this.stride = null;
    this.#height = Math.max(...this.lines().flat(2).map(Math.abs));
    this.#remember();
  }

  get state() {
    const row = this.#block.row("record.state"), half = this.#size / 2, { room } = this.#block.notes;
    return Array.from({ length: this.#size }, (_, i) => row[i < half ? i : room + i - half]);
  }

  /** Whether the walk has ended: by a fall, or without a further heelstrike. */
  get over() {
    return this.outcome !== null && this.outcome !== "HEELSTRIKE";
  }

  /** Points at which the last strides began. */
  get footholds() {
    return this.#trace.map((each) => ({ ...each }));
  }

  /** The stride map under held controls; the walk of this object stays as it is. */
  strideFrom(state, others = {}) {
    const { controls = null, end = 20, slope = this.slope, height_change = 0 } =
      options(others, ["controls", "end", "slope", "height_change"], "strideFrom");
    for (const [name, value] of Object.entries({ end, slope, height_change })) finite(name, value);
    if (height_change !== 0) this.#even();
    const block = this.#block, kept = block.bytes.slice(block.base, block.scratch);
    try {
      this.#choose(height_change !== 0);
      this.#put(state);
      this.#hold(controls);
      this.#ground({ ...SMOOTH, rises: [height_change] }, 0, slope);
      this.#advance(end, true);
      const outcome = block.get("record.outcome") || block.notes.outcomes.indexOf("STALLED");
      return {
        outcome: block.notes.outcomes[outcome], state: this.state, duration: block.get("record.time"),
        step_length: block.get("record.step_length"), heel_loss: block.get("record.heel_loss"),
      };
    } finally {
      block.bytes.set(kept, block.base);
    }
  }

  /** Walks for a time in sqrt(l/g), or to the next heelstrike; returns how it ended, or null. */
  step(duration = 0.1, controls = null) {
    const block = this.#block, { outcomes } = block.notes;
    finite("duration", duration);
    if (this.over) return this.outcome;
    if (this.outcome === "HEELSTRIKE") {
      this.#put(this.state);
      this.#ground(this.terrain, this.strides);
      this.fresh = true;
    }
    this.#hold(controls);
    if (this.#impulse) {
      block.set("impulse", this.#impulse);
      block.run(PUSH);
      this.#impulse = 0;
    }
    this.#remember();
    this.#advance(block.get("record.time") + duration, this.fresh);
    this.fresh = false;
    this.duration = block.get("record.time") - this.#earlier.time;
    const outcome = block.get("record.outcome");
    this.outcome = outcome ? outcomes[outcome] : null;
    if (this.outcome === "HEELSTRIKE") {
      this.strides += 1;
      this.stride = { step_length: block.get("record.step_length"), step_period: block.get("record.time") };
      const { x, y } = this.#trace[this.#trace.length - 1];
      this.#trace.push({ strides: this.strides, x: x + block.get("record.step_length"), y: y + this.rise });
      if (this.#trace.length > 12) this.#trace.shift();
    }
    return this.outcome;
  }

  /** Pushes the centre of mass when the next control step begins: an impulse, positive downhill; pushes add. */
  push(impulse) {
    if (!this.#block.notes.pushed) throw new SceneError(`the equations of ${this.name} do not say what a push does`);
    if (!Number.isFinite(impulse) || Math.abs(impulse) > 10) {
      throw new SceneError(`impulse must be a number from -10 to 10, not ${shown(impulse)}`);
    }
    if (!this.over) this.#impulse += impulse;
  }

  #remember() {
    const block = this.#block;
    block.record("before").set(block.record("record"));
    this.#earlier = { time: block.get("record.time"), fresh: this.fresh, place: this.#trace[this.#trace.length - 1] };
  }

  /** Lines of points [x, y] that show a state, from the stance foot. */
  lines(state = this.state) {
    const block = this.#block, { notes } = block, body = Object.values(this.fields), at = block.scratch;
    state.forEach((x, i) => (block.f8[at / 8 + body.length + i] = x));
    let next = at / 8 + body.length + state.length;
    block.functions.pose(at, 8 * next);
    return notes.lines.map((count) => Array.from({ length: count }, () => [block.f8[next++], block.f8[next++]]));
  }

  #placed(state, { strides, x, y }) {
    return { state, strides, lines: this.lines(state).map((line) => line.map(([a, b]) => [a + x, b + y])), contact: [x, y] };
  }

  /** The system now, for a picture. */
  frame() {
    return this.#placed(this.state, this.#trace[this.#trace.length - 1]);
  }

  /** The system within the last control step, at a share from 0 to 1 of it; exact, for a picture. */
  within(share) {
    if (share >= 1 || !(this.duration > 0)) return this.frame();
    const block = this.#block, kept = block.bytes.slice(block.base, block.scratch);
    try {
      block.record("record").set(block.record("before"));
      this.#advance(this.#earlier.time + Math.max(share * this.duration, 1e-9), this.#earlier.fresh);
      return this.#placed(this.state, this.#earlier.place);
    } finally {
      block.bytes.set(kept, block.base);
    }
  }

  /**
   * Searches for the periodic gait near a state by Newton's method, with finite differences.
   *
   * Returns its state, its Floquet multipliers [re, im] and its stride; null if none is found.
   */
  findGait(others = {}) {
    const { guess = null, controls = null, slope = this.slope, tries = 30 } =
      options(others, ["guess", "controls", "slope", "tries"], "findGait");
    whole("tries", tries, 1, 1e6);
    const start = guess ?? this.#block.notes.start;
    if (start === null) return null;
    const found = fixedPoint((state) => {
      const stride = this.strideFrom(state, { controls, slope });
      return stride.outcome === "HEELSTRIKE" ? { point: stride.state, stride } : null;
    }, start, tries);
    return found && { state: found.point, multipliers: found.multipliers, stride: found.end.stride };
  }

  /** Draws the system and its ground on a canvas, `width` units of length wide. */
  render(canvas, others = {}) {
    const { colors = {}, frame = this.frame(), width = 2.5 * this.#height, push = null } = options(others, DRAWN, "render");
    const found = { ...COLORS, ...options(colors, Object.keys(COLORS), "colors") };
    const context = canvas.getContext("2d"), scale = canvas.width / width;
    const middle = frame.contact, place = placeOn(canvas, this.slope, middle, scale);
    context.fillStyle = found.background;
    context.fillRect(0, 0, canvas.width, canvas.height);
    drawGround(context, place, middle[0], width, found, scale, 1, this.terrain && this.footholds);
    context.lineCap = context.lineJoin = "round";
    context.lineWidth = 0.035 * scale;
    const legs = frame.strides % 2 ? [found.even, found.odd] : [found.odd, found.even];
    frame.lines.forEach((line, i) => {
      context.strokeStyle = legs[i] ?? found.body;
      context.beginPath();
      line.forEach((point, k) => (k ? context.lineTo(...place(point)) : context.moveTo(...place(point))));
      context.stroke();
    });
    if (push) drawPush(context, place(frame.lines[0][0]), push, found.push, scale);
  }
}
