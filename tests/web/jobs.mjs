// Jobs of tests: what walkers do, with memory as base64. For Node.js and for pages.

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

function text(data) {
  let found = "";
  for (const byte of data) found += String.fromCharCode(byte);
  return btoa(found);
}

/** Integrates records as they are; returns them, the walker's constants and microseconds each. */
async function strides(walkers, { walker, scene, records, tolerance, fromSection, body }) {
  const walk = await walkers.create(walker, scene);
  const block = walk.block, size = block.record("record").length;
  block.tolerate(tolerance, walk.scene.end_on_toe_stub, fromSection);
  const own = block.bytes.slice(block.at("bodies"), block.at("bodies") + 8 * block.notes.constants);
  if (body) block.bytes.set(bytes(body), block.at("bodies"));
  const all = bytes(records);
  const began = performance.now();
  for (let at = 0; at < all.length; at += size) {
    block.record("record").set(all.subarray(at, at + size));
    block.run(0);
    all.set(block.record("record"), at);
  }
  return { records: text(all), body: text(own), time: ((performance.now() - began) * 1e3 * size) / all.length };
}

/** Takes episodes of control steps; returns what each step leaves in memory. */
async function episodes(walkers, { walker, scene, body, starts }) {
  const walk = await walkers.create(walker, scene);
  const block = walk.block, found = [];
  if (body) block.bytes.set(bytes(body), block.at("bodies"));
  for (const { key, state, actions } of starts) {
    const rows = [text(new Uint8Array(walk.reset({ seed: BigInt(key), state }).buffer))];
    for (const action of actions) {
      const { observation, reward, terminated, truncated } = walk.step(action);
      rows.push([
        text(block.record("record")), text(block.record("ledger")), text(block.record("disturbance")),
        text(new Uint8Array(observation.buffer)), reward, terminated, truncated,
      ]);
      if (walk.over) break;
    }
    found.push(rows);
  }
  return found;
}

/** Returns the message with which something is refused, or null. */
async function refusal(walkers, { walker, scene }) {
  try {
    await walkers.create(walker, scene);
    return null;
  } catch (error) {
    return `${error.name}: ${error.message}`;
  }
}

/** Returns the messages with which calls are refused, or null; each is its name and its arguments. */
async function refusals(walkers, { calls, system }) {
  const walk = await walkers.create("C", {});
  const own = await walkers.createSystem(system);
  const { predict } = await walkers.loadPolicy("level-ppo");
  const owners = { walkers, walk, own, policy: { predict } };
  const found = [];
  for (const [owner, name, ...given] of calls) {
    try {
      await owners[owner][name](...given.map(inherited));
      found.push(null);
    } catch (error) {
      found.push(`${error.name}: ${error.message}`);
    }
  }
  return found;
}

/** An argument in which `inherits` names entries of its prototype. */
function inherited(given) {
  if (given === null || typeof given !== "object" || !given.inherits) return given;
  const { inherits, ...own } = given;
  return Object.assign(Object.create(inherits), own);
}

async function policy(walkers, { name, observations }) {
  const { predict } = await walkers.loadPolicy(name);
  return observations.map((each) => predict(each));
}

async function joints(walkers, { walker, states }) {
  const walk = await walkers.create(walker, { max_hip_torque: 0 });
  return states.map((state) => {
    walk.reset({ state });
    return walk.joints();
  });
}

async function gait(walkers, { walker, slope }) {
  const walk = await walkers.create(walker, { slope });
  return walk.findGait();
}

/** An episode on a slope of its own: slopes, its gait, and the state after pushes and a control step. */
async function begun(walkers, { walker, scene, slope, pushes }) {
  const walk = await walkers.create(walker, scene);
  walk.reset({ slope });
  const { gravity_work, step_length } = walk.findGait().stride;
  pushes.forEach((impulse) => walk.push(impulse));
  walk.step();
  const { state } = walk;
  walk.change({ scene: { energy_weight: 0.5 } });
  const slopes = [walk.slope, walk.block.get("ledger.slope"), gravity_work / step_length];
  walk.reset();
  return { slopes, state, again: walk.slope, pushed: walk.block.get("disturbance.known") };
}

/** Strides of a system of one's own, walks by control steps, lines, a gait, and a refusal. */
async function system(walkers, { name, options, states, controls, ticks, disturbed }) {
  const walk = await walkers.createSystem(name, options);
  const strides = states.map((state) => walk.strideFrom(state, { controls }));
  const lines = states.map((state) => walk.lines(state));
  walk.reset(states[0]);
  const steps = [];
  for (let i = 0; i < ticks; i++) steps.push([walk.step(0.1, controls), walk.state]);
  const within = [walk.within(1e-9).state, walk.within(1).state];
  const other = await walkers.createSystem(name, { ...options, terrain: disturbed.terrain, seed: disturbed.seed, state: states[0] });
  const uneven = [];
  for (let i = 0; i < ticks; i++) {
    if (i % disturbed.every === 0) other.push(disturbed.impulse);
    uneven.push([other.step(0.1, controls), other.state]);
  }
  let refused = null;
  try {
    walk.change({ body: { fin: 1 } });
  } catch (error) {
    refused = `${error.name}: ${error.message}`;
  }
  const rises = walk.strideFrom(states[0], { controls, height_change: 0.001 }).state;
  const gait = walk.findGait({ controls });
  return { strides, lines, steps, within, walked: walk.strides, uneven, footholds: other.footholds, rises, gait, refused };
}

async function stridesOfSystem(walkers, { name, options, states }) {
  const walk = await walkers.createSystem(name, options);
  return states.map((state) => walk.strideFrom(state));
}

const DOES = { strides, episodes, refusal, refusals, policy, joints, gait, begun, system, "strides of a system": stridesOfSystem };

/** Does a job with the module `passive-walker.js`; returns its result. */
export const run = (walkers, job) => DOES[job.what](walkers, job);
