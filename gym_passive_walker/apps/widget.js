// The player as a widget of notebooks; the package's two modules stand before this one.

const SHORTEST = 100; // ms between two reports to Python

/** State of a walk for Python, by the names of the widget's traits. */
function reported({ walk, settings, running }) {
  const own = (x, i) => (settings.system || i < 3 ? x : x / walk.timeUnit);
  return {
    state: walk.state.map(own), strides: walk.strides, outcome: walk.over ? (walk.outcome ?? "") : "",
    parameters: walk.walker ?? walk.fields, policy: settings.policy, slope: settings.slope, hip_torque: settings.torque,
    speed: settings.speed, running,
  };
}

async function render({ model, el }) {
  const read = async (name) => {
    const files = model.get("files"), file = Object.hasOwn(files, name) && files[name];
    if (!file) throw new Error(`the notebook has no file ${name}`);
    return new Uint8Array(file.buffer, file.byteOffset, file.byteLength);
  };
  let before = -Infinity;
  const report = (player) => {
    const now = performance.now();
    if (now - before < SHORTEST && player.running && !player.walk.over) return;
    before = now;
    for (const [name, value] of Object.entries(reported(player))) {
      if (!same(value, model.get(name))) model.set(name, value);
    }
    model.save_changes();
  };
  const wanted = () => ({ slope: model.get("slope"), torque: model.get("hip_torque"), speed: model.get("speed") });
  const root = element("div");
  el.append(root);
  const paused = model.get("running") ? undefined : true;
  const given = { ...model.get("given"), ...wanted(), paused, read, onstate: report };
  if (given.system) delete given.torque;
  const player = await play(root, given);
  report(player);
  const heard = {
    "change:running": () => model.get("running") !== player.running && player.toggle(),
    "msg:custom": ({ push, again }) => (again ? player.begin() : player.push(push)),
  };
  for (const name of ["slope", "hip_torque", "speed"]) {
    heard[`change:${name}`] = () => {
      const { slope, torque, speed } = player.settings;
      if (!same(wanted(), { slope, torque, speed })) player.set(wanted());
    };
  }
  for (const [event, act] of Object.entries(heard)) model.on(event, act);
  return () => {
    player.stop();
    for (const [event, act] of Object.entries(heard)) model.off(event, act);
  };
}

export default { render };
