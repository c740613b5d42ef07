// A walker in a page: picture, controls, phase portrait and Floquet multipliers.
//
//     import { play } from "./player.js";
//     play(document.querySelector("#walker"), { walker: "lab", slope: 0.036 });
//     play(document.querySelector("#walker"), { system: "torso" }); // one of Python's web.build

import { checkScene, checkWalker, create, createSystem, library, loadPolicy, readFile } from "./passive-walker.js";

const TORQUE = 0.05; // m g l: the hip torque of the action 1, unless a larger one is held
const TRAIL = 900; // frames in the phase portrait
const LONGEST_FRAME = 0.1; // s
const PUSH_KEY = 0.01; // m sqrt(g l)
const PUSH_PIXEL = 0.0002;
const LARGEST_PUSH = 10; // as in an environment
const SLOWEST = 2 ** -6, FASTEST = 4; // times the walker's own pace
const REST = 1.6; // s between a fall and the next start
const ADDRESS_DELAY = 300; // ms from a change to the address that has it: WebKit allows 100 in 10 s
const GROUNDS = {
  smooth: { label: "smooth", terrain: null },
  rough: { label: "rough, deviation 0.002 l", terrain: { rough: { height_std: 0.002 } } },
  rougher: { label: "rough, deviation 0.005 l", terrain: { rough: { height_std: 0.005 } } },
  waves: { label: "waves of 0.004 l", terrain: { waves: { height: 0.004, strides: 6 } } },
};
const UNITS = {
  thigh_length: "m", thigh_offset: "m", thigh_mass: "kg", thigh_gyration: "m", thigh_com: "m",
  shank_length: "m", shank_offset: "m", shank_mass: "kg", shank_gyration: "m", shank_com: "m",
  foot_radius: "m", foot_angle: "rad", hip_mass: "kg", hip_stiffness: "N m/rad",
  hip_friction: "N m s/rad", knee_stiffness: "N m/rad", gravity: "m/s²",
};
const ENDINGS = {
  FELL_FORWARD: "The walker fell forward.",
  FELL_BACKWARD: "The walker fell backward.",
  SWING_OVERROTATION: "The swing leg went beyond the upright.",
  STUBBED_TOE: "The swing foot stubbed its toe.",
  KNEE_NOT_LOCKED: "The foot came down before the knee had locked.",
  STALLED: "The walker stalled.",
  DIVERGED: "The motion diverged.",
};

let count = 0;

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== false && value !== null) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

function labelled(text, control, output = "") {
  control.id = `pw-${++count}`;
  return element("div", { class: "pw-field" }, element("label", { for: control.id }, text), control, output);
}

function choice(entries, value, change) {
  const options = entries.map(([key, text]) => element("option", { value: key, selected: key === value }, text));
  return element("select", { onchange: (event) => change(event.target.value) }, ...options);
}

function digits(x, places = 4) {
  return x === 0 ? "0" : Number(x.toPrecision(places)).toString();
}

/** Whether two objects have the same entries. */
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** A slope, or the middle of a range of slopes. */
const middle = (slope = 0) => (Array.isArray(slope) ? 0.5 * (slope[0] + slope[1]) : slope);

/** Settings with the walker and the slope of their policy, where they have none of their own. */
function withPolicy(settings, data) {
  const scene = settings.policy && data.policies[settings.policy].scene;
  if (!scene) return settings;
  const { walker = "C" } = scene, { preset, ...changes } = typeof walker === "string" ? { preset: walker } : walker;
  const own = settings.walker === undefined ? { walker: preset, changes: { ...changes, ...settings.changes } } : {};
  return { slope: middle(scene.slope), ...settings, ...own };
}

/** Whether a scene can run in a page, at the middle of its slopes; some arguments are available in Python only. */
function runs(scene, data) {
  try {
    checkScene({ ...scene, slope: middle(scene.slope) }, checkWalker(scene.walker ?? "C", data), data);
    return true;
  } catch {
    return false;
  }
}

/** A player in an element; `play` makes it. */
export class Player {
  constructor(root, data, settings) {
    this.root = root;
    this.data = data;
    this.read = settings.read ?? readFile;
    this.share = settings.share ?? false;
    this.listener = settings.onstate ?? null;
    this.compact = settings.compact ?? false;
    this.settings = {
      walker: "lab", changes: {}, slope: 0.036, torque: 0, policy: "", ground: "smooth", speed: 1, seed: 0,
      ...settings.settings,
    };
    this.home = this.settings;
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    this.running = settings.paused === undefined ? !still.matches : !settings.paused;
    this.trail = [];
    this.pending = 0;
    this.progress = 1;
    this.rest = 0;
    this.gait = null;
    this.last = null;
    this.drag = null;
    this.#build();
  }

  // ------------------------------------------------------------------------------------------
  // The page's elements.

  #build() {
    this.canvas = element("canvas", {
      class: "pw-scene", width: 960, height: 480, tabindex: 0, role: "img",
      "aria-label": "A walker on a slope. Press the arrow keys left and right to push it, the space bar to pause.",
      onkeydown: (event) => this.#key(event),
      onpointerdown: (event) => this.#press(event),
      onpointermove: (event) => this.#move(event),
      onpointerup: (event) => this.#release(event),
      onpointercancel: () => (this.drag = null),
    });
    this.said = element("p", { class: "pw-said", role: "status", "aria-live": "polite" });
    this.pause = element("button", { type: "button", onclick: () => this.toggle() });
    this.sliders = {};
    const fields = this.fields();
    this.more = element(
      "details", { class: "pw-more" },
      element("summary", {}, "All parameters of the walker"),
      element("div", { class: "pw-fields" }, ...this.parameters()),
    );
    const buttons = [
      this.pause,
      element("button", { type: "button", onclick: () => this.next() }, "Next frame"),
      element("button", { type: "button", onclick: () => this.begin() }, "Begin again"),
      element("button", { type: "button", onclick: () => this.push(-PUSH_KEY) }, "Push uphill"),
      element("button", { type: "button", onclick: () => this.push(PUSH_KEY) }, "Push downhill"),
    ];
    this.film = null;
    if (globalThis.MediaRecorder && this.canvas.captureStream) {
      this.film = element("button", { type: "button", onclick: () => this.record() });
      buttons.push(this.film);
    }
    if (this.share) buttons.push(element("button", { type: "button", onclick: () => this.#link() }, "Copy link"));
    this.portrait = element("canvas", {
      class: "pw-plot", width: 460, height: 320, role: "img",
      "aria-label": this.portraitOf,
    });
    this.circle = element("canvas", {
      class: "pw-plot", width: 320, height: 320, role: "img", "aria-label": "Floquet multipliers in the complex plane",
    });
    this.multipliers = element("p", { class: "pw-note" });
    this.measures = element("dl", { class: "pw-measures" });
    this.root.classList.add("pw");
    this.root.replaceChildren(
      this.canvas, this.said, element("div", { class: "pw-buttons" }, ...buttons),
      element("div", { class: "pw-fields" }, ...fields),
      this.more,
      element(
        "div", { class: "pw-plots" },
        element("figure", {}, this.portrait, element("figcaption", {}, `${this.portraitOf}; dots are now`)),
        element(
          "figure", {}, this.circle,
          element("figcaption", {}, "Floquet multipliers by finite differences of strides"), this.multipliers,
        ),
        element("div", {}, element("p", { class: "pw-title" }, "Last stride"), this.measures),
      ),
    );
    if (this.compact) this.root.classList.add("pw-compact");
  }

  get portraitOf() {
    return "Phase portrait: angular velocity over angle of both legs";
  }

  groundChoice() {
    const entries = Object.entries(GROUNDS).map(([name, { label }]) => [name, label]);
    return (this.grounds = choice(entries, this.settings.ground, (value) => this.set({ ground: value }, true)));
  }

  /** Choices, and the sliders that act on every walker. */
  fields() {
    const { settings, data } = this;
    const walkers = Object.entries(data.walkers).map(([name, { about }]) => [name, `${name}: ${about}`]);
    const policies = Object.keys(data.policies).filter((name) => runs(data.policies[name].scene, data)).map((name) => [`policy ${name}`, `policy ${name}`]);
    this.walkerChoice = choice(walkers, settings.walker, (value) => this.#choose(value));
    this.controllers = choice(
      [["passive", "passive"], ["torque", "held hip torque"], ...policies],
      settings.policy ? `policy ${settings.policy}` : settings.torque ? "torque" : "passive",
      (value) => this.#control(value),
    );
    return [
      labelled("Walker", this.walkerChoice), labelled("Controller", this.controllers),
      labelled("Ground", this.groundChoice()),
      this.slider("slope", "Slope, rad", -0.02, 0.12, 0.0005),
      this.slider("torque", "Hip torque, m g l", -0.03, 0.03, 0.0005),
      this.slider("speed", "Speed", SLOWEST, FASTEST, SLOWEST),
      this.slider("gravity", "Gravity, m/s²", 0.5, 25, 0.01),
    ];
  }

  /** Sliders of the walker's parameters. */
  parameters() {
    const others = this.data.parameters.filter((name) => name !== "gravity");
    return others.map((name) => this.slider(name, `${name}, ${UNITS[name]}`));
  }

  slider(name, label, least, most, step = "any") {
    const output = element("output");
    const input = element("input", {
      type: "range", step,
      oninput: () => this.slide(name, Number(input.value)),
      ondblclick: () => this.slide(name, this.homeOf(name)),
      onkeydown: ({ key }) => key === "Delete" && this.slide(name, this.homeOf(name)),
    });
    const field = labelled(label, input, output);
    output.setAttribute("for", input.id);
    this.sliders[name] = { input, output, field, range: least === undefined ? null : [least, most] };
    return field;
  }

  /** Writes the settings into the sliders. */
  #show() {
    const { settings } = this;
    for (const [name, { input, output, range }] of Object.entries(this.sliders)) {
      const value = name in settings ? settings[name] : this.valueOf(name);
      const [least, most] = range ?? this.rangeOf(name);
      input.min = Math.min(least, value);
      input.max = Math.max(most, value);
      if (Number(input.value) !== value) input.value = value;
      output.textContent = name === "speed" ? `× ${digits(value)}` : digits(value);
      input.setAttribute("aria-valuetext", `${digits(value)} ${UNITS[name] ?? ""}`.trim());
    }
    this.pause.textContent = this.running ? "Pause" : "Continue";
    if (this.film) this.film.textContent = this.recorder ? "Save video" : "Record video";
    this.showChoices();
  }

  valueOf(name) {
    return this.walk.parameters[name];
  }

  /** Value of a slider when the walker was chosen. */
  homeOf(name) {
    const { home, data } = this;
    return home[name] ?? home.changes[name] ?? data.walkers[home.walker].parameters[name];
  }

  /** Least and largest value of a parameter's slider. */
  rangeOf(name) {
    const own = this.data.walkers[this.settings.walker].parameters[name];
    const size = Math.abs(own ?? 0) || (UNITS[name] === "m" ? 0.1 : UNITS[name] === "rad" ? 0.1 : 0.5);
    const signed = ["thigh_offset", "shank_offset", "foot_angle"].includes(name);
    return [signed ? -2 * size : 0, (own ? 2 : 1) * size];
  }

  showChoices() {
    const { settings } = this;
    this.sliders.torque.input.disabled = settings.policy !== "";
    this.controllers.value = settings.policy ? `policy ${settings.policy}` : settings.torque || this.controllers.value === "torque" ? "torque" : "passive";
    this.grounds.value = settings.ground;
    this.walkerChoice.value = settings.walker;
  }

  // ------------------------------------------------------------------------------------------
  // What a user changes.

  slide(name, value) {
    if (name === "slope" || name === "torque" || name === "speed") this.set({ [name]: value }, name === "torque");
    else this.set({ changes: { ...this.settings.changes, [name]: value } });
  }

  #choose(walker) {
    const gaits = this.data.walkers[walker].gaits;
    const near = gaits.reduce((best, each) => (Math.abs(each[0] - 0.03) < Math.abs(best[0] - 0.03) ? each : best), gaits[0]);
    this.set({ walker, changes: {}, policy: "", slope: near ? near[0] : 0.03 }, true);
  }

  #control(value) {
    if (value.startsWith("policy ")) {
      const policy = value.slice(7), { scene } = this.data.policies[policy];
      this.set({ ...withPolicy({ policy }, this.data), torque: 0, ground: scene.terrain ? "rough" : "smooth" }, true);
    } else {
      this.set({ policy: "", torque: value === "torque" ? this.settings.torque || 0.002 : 0 }, this.settings.policy !== "");
    }
  }

  /** Changes settings; a walker that cannot be leaves all as it is, and says why. */
  async set(changes, again = false) {
    const before = this.settings;
    this.settings = { ...before, ...changes };
    const home = this.home;
    if (before.walker !== this.settings.walker) this.home = this.settings;
    const key = ["walker", "changes", "policy", "ground", "slope", "torque", "controls"];
    try {
      this.check();
      const others = ["walker", "policy", "ground"].some((name) => before[name] !== this.settings[name]);
      if (others || this.settings.start || (again && this.walk.over)) await this.begin();
      else if (key.some((name) => !same(before[name], this.settings[name]))) this.#changed();
      this.#announce("");
    } catch (error) {
      [this.settings, this.home] = [before, home];
      this.#announce(error.message);
    }
    this.#show();
    this.#remember();
    this.listener?.(this);
  }

  #walkerGiven() {
    return { preset: this.settings.walker, ...this.settings.changes };
  }

  #scene() {
    const { settings } = this, { terrain } = GROUNDS[settings.ground];
    const own = settings.policy ? this.data.policies[settings.policy].scene : this.motor;
    const rules = { reset_noise_scale: 0, slope: settings.slope, terrain: terrain ?? (own.terrain_lookahead ? { stairs: { rise: 0 } } : null) };
    const stub = settings.policy ? {} : { end_on_toe_stub: false };
    const { walker: _, ...scene } = { ...own, ...rules, ...stub }; // the settings have the walker
    return scene;
  }

  /** The motor of a walker without a policy: it is as strong as the held torque. */
  get motor() {
    return { max_hip_torque: Math.max(TORQUE, Math.abs(this.settings.torque)) };
  }

  check() {
    checkWalker(this.#walkerGiven(), this.data);
  }

  /** Gives the walker the settings. */
  change() {
    const { slope, policy } = this.settings;
    this.walk.change({ walker: this.#walkerGiven(), scene: { slope, ...(policy ? {} : this.motor) } });
  }

  #changed() {
    this.change();
    this.last = null;
    this.#seek();
  }

  /** Makes the walker of the settings, at a state or at its periodic gait. */
  async make(start) {
    const walk = await create(this.#walkerGiven(), this.#scene(), { read: this.read });
    const policy = this.settings.policy ? await loadPolicy(this.settings.policy, { read: this.read }) : null;
    this.policy = policy;
    this.walk = walk;
    const gait = start || policy ? null : this.findGait();
    this.observation = walk.reset({ seed: this.settings.seed++, noise: false, state: start ?? gait?.state ?? null });
  }

  findGait() {
    const { slope, torque, policy } = this.settings;
    return this.walk.findGait({ slope, hip_torque: policy ? 0 : torque });
  }

  /** Begins again with the settings, at the periodic gait or near it. */
  async begin() {
    const start = this.settings.start ?? null;
    await this.make(start);
    this.settings.start = undefined;
    this.trail = [];
    this.progress = 1;
    this.rest = 0;
    this.last = null;
    this.action = null;
    this.#announce("");
    this.#show();
    this.#seek();
    this.draw();
  }

  push(impulse) {
    this.pending += impulse;
  }

  toggle() {
    this.running = !this.running;
    this.#show();
    this.listener?.(this);
  }

  next() {
    this.running = false;
    this.advance(1 / 60);
    this.#show();
    this.draw();
  }

  /** Begins a video of the picture; or ends it, and saves its file. */
  record() {
    if (this.recorder) {
      this.recorder.stop();
      return;
    }
    const parts = [];
    let recorder;
    try {
      recorder = new MediaRecorder(this.canvas.captureStream());
      recorder.start();
    } catch (error) {
      this.#announce(`This browser records no video: ${error.message}`);
      return;
    }
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.onstop = () => {
      const { type } = parts[0], href = URL.createObjectURL(new Blob(parts, { type }));
      element("a", { href, download: type.includes("mp4") ? "walk.mp4" : "walk.webm" }).click();
      setTimeout(() => URL.revokeObjectURL(href), 1000);
      this.recorder = null;
      this.#show();
    };
    this.recorder = recorder;
    this.#show();
  }

  /** Chooses the next entry of a list, or the previous one. */
  #further(list, step = 1) {
    if (!list) return;
    const { length } = list.options;
    list.selectedIndex = (list.selectedIndex + step + length) % length;
    list.dispatchEvent(new Event("change"));
  }

  #key(event) {
    const keys = {
      " ": () => this.toggle(), n: () => this.next(), r: () => this.begin(),
      w: () => this.#further(this.walkerChoice), W: () => this.#further(this.walkerChoice, -1),
      p: () => this.#further(this.controllers), P: () => this.#further(this.controllers, -1),
      f: () => this.film && this.record(),
      ArrowLeft: () => this.push(-PUSH_KEY), ArrowRight: () => this.push(PUSH_KEY),
      "+": () => this.set({ speed: Math.min(FASTEST, this.settings.speed * 2) }),
      "-": () => this.set({ speed: Math.max(SLOWEST, this.settings.speed / 2) }),
    };
    const does = Object.hasOwn(keys, event.key) ? keys[event.key] : null;
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    does();
  }

  #press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.drag = { from: event.clientX, to: event.clientX };
  }

  #move(event) {
    if (this.drag) this.drag.to = event.clientX;
    if (this.drag && !this.running) this.draw();
  }

  /** A drag pushes by its length; a click pushes away from where it is. */
  #release(event) {
    if (!this.drag) return;
    const moved = event.clientX - this.drag.from;
    const box = this.canvas.getBoundingClientRect();
    const side = event.clientX < box.left + box.width / 2 ? 1 : -1;
    this.push(Math.abs(moved) > 5 ? moved * PUSH_PIXEL : side * PUSH_KEY);
    this.drag = null;
  }

  #announce(text) {
    this.said.textContent = text;
  }

  // ------------------------------------------------------------------------------------------
  // Sharing by the address.

  #remember() {
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => this.#write(), ADDRESS_DELAY);
  }

  #write() {
    clearTimeout(this.remembering);
    if (!this.share) return;
    const { walker, changes, slope, torque, policy, ground, speed } = this.settings;
    const given = { walker, slope: digits(slope, 8), ...(torque && { torque }), ...(policy && { policy }) };
    if (ground !== "smooth") given.ground = ground;
    if (speed !== 1) given.speed = speed;
    for (const [name, value] of Object.entries(changes)) given[name] = digits(value, 8);
    try {
      history.replaceState(null, "", `#${new URLSearchParams(given)}`);
    } catch {
      // The browser allows so many changes in a time; the next one writes the address.
    }
  }

  async #link() {
    this.#write();
    try {
      await navigator.clipboard.writeText(location.href);
      this.#announce("The link is copied.");
    } catch {
      this.#announce("The address of this page has the settings.");
    }
  }

  // ------------------------------------------------------------------------------------------
  // Time.

  /** Continues by a time in seconds. */
  advance(seconds) {
    const { walk } = this;
    let left = (seconds * this.settings.speed) / walk.timeUnit;
    if (walk.over && this.progress >= 1) {
      this.rest += seconds;
      if (this.rest > REST && this.running) this.begin();
      return;
    }
    for (let i = 0; i < 1000 && left > 0; i++) {
      const rest = (1 - this.progress) * (walk.duration || 0);
      if (rest > left) {
        this.progress += left / walk.duration;
        left = 0;
      } else {
        left -= rest;
        this.progress = 1;
        this.#record(walk.frame());
        if (walk.over) return this.#ended();
        this.#step();
        this.progress = 0;
      }
    }
  }

  #step() {
    if (this.pending) {
      const wanted = Math.max(-LARGEST_PUSH, Math.min(LARGEST_PUSH, this.pending));
      this.walk.push(wanted);
      this.pending = 0;
      this.last = null;
    }
    const last = this.step();
    if (last) {
      this.last = last;
      this.#measure();
    }
    this.listener?.(this);
  }

  /** Takes a control step; returns the measures of a stride that it ends. */
  step() {
    const { walk, settings } = this;
    this.action = this.policy ? this.policy.predict(this.observation) : [settings.torque / this.motor.max_hip_torque];
    const found = walk.step(this.action);
    this.observation = found.observation;
    return found.info.outcome === "HEELSTRIKE" ? found.info : null;
  }

  #ended() {
    this.rest = 0;
    const { outcome } = this.walk;
    this.#announce(`${ENDINGS[outcome] ?? "The episode ended."} It begins again in a moment, or by “Begin again”.`);
  }

  #measure() {
    const rows = [...this.measured(this.last), ["strides", String(this.walk.strides)]];
    this.measures.replaceChildren(...rows.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
  }

  /** Names and texts of a stride's measures. */
  measured(last) {
    const l = this.walk.legLength, t = this.walk.timeUnit;
    return [
      ["step length", `${digits(last.step_length * l)} m`],
      ["step period", `${digits(last.step_period * t)} s`],
      ["speed", `${digits((last.speed * l) / t)} m/s`],
      ["cost of transport", digits(last.cost_of_transport)],
    ];
  }

  /** Searches for the periodic gait when the settings have been left alone for a moment. */
  #seek() {
    clearTimeout(this.timer);
    this.gait = undefined;
    this.timer = setTimeout(() => {
      this.gait = this.findGait();
      this.#drawMultipliers();
    }, 350);
  }

  // ------------------------------------------------------------------------------------------
  // Pictures.

  #colors() {
    const style = getComputedStyle(this.root), get = (name) => style.getPropertyValue(`--pw-${name}`).trim();
    return Object.fromEntries(["background", "ground", "mark", "even", "odd", "body", "push"].map((name) => [name, get(name)]));
  }

  draw() {
    if (!this.walk) return;
    const frame = this.walk.within(this.progress);
    this.colors = this.#colors();
    const push = this.drag ? (this.drag.to - this.drag.from) * PUSH_PIXEL : null;
    this.walk.render(this.canvas, { colors: this.colors, frame, push });
    this.#record(frame);
    this.#drawPortrait(frame);
  }

  /** Adds a frame to the phase portrait; ends of control steps are in it at any frame rate. */
  #record(frame) {
    this.trail.push(frame);
    if (this.trail.length > TRAIL) this.trail.shift();
  }

  #drawPortrait(now) {
    const { portrait: canvas, trail, colors } = this, context = canvas.getContext("2d");
    context.fillStyle = colors.background;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const [angle, rate] = this.window(now);
    const place = (x, v) => [canvas.width * (0.5 + x / (2 * angle)), canvas.height * (0.5 - v / (2 * rate))];
    context.strokeStyle = colors.mark;
    context.lineWidth = 1;
    context.strokeRect(0.5, 0.5, canvas.width - 1, canvas.height - 1);
    context.beginPath();
    context.moveTo(...place(-angle, 0));
    context.lineTo(...place(angle, 0));
    context.moveTo(...place(0, -rate));
    context.lineTo(...place(0, rate));
    context.stroke();
    this.curves(now).forEach((end, k) => {
      context.strokeStyle = [colors.even, colors.odd, colors.body, colors.mark][k % 4];
      context.lineWidth = 1.5;
      context.beginPath();
      let before = null;
      for (const frame of trail) {
        const at = place(...this.curves(frame)[k]);
        if (before === frame.strides) context.lineTo(...at);
        else context.moveTo(...at);
        before = frame.strides;
      }
      context.stroke();
      context.fillStyle = context.strokeStyle;
      context.beginPath();
      context.arc(...place(...end), 5, 0, 2 * Math.PI);
      context.fill();
    });
    context.fillStyle = colors.mark;
    context.font = "15px system-ui, sans-serif";
    context.textAlign = "right";
    context.fillText(`${angle} rad`, canvas.width - 6, canvas.height / 2 - 6);
    context.textAlign = "left";
    context.fillText(`${rate} √(g/l)`, canvas.width / 2 + 6, 18);
  }

  /** Largest angle and angular velocity in the phase portrait. */
  window() {
    return [0.65, 2.2];
  }

  /** A point of the phase portrait for each curve: a leg is the stance leg in every other stride. */
  curves({ state, strides }) {
    const legs = [[state[0], state[3]], [state[1], state[4]]];
    return strides % 2 ? legs.reverse() : legs;
  }

  #drawMultipliers() {
    const { circle: canvas, gait } = this, colors = this.#colors(), context = canvas.getContext("2d");
    context.fillStyle = colors.background;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const size = Math.max(1.25, ...(gait?.multipliers ?? []).map(([re, im]) => 1.15 * Math.hypot(re, im)));
    const scale = canvas.width / (2 * size), middle = canvas.width / 2;
    context.strokeStyle = colors.mark;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(0, middle);
    context.lineTo(canvas.width, middle);
    context.moveTo(middle, 0);
    context.lineTo(middle, canvas.height);
    context.stroke();
    context.strokeStyle = colors.ground;
    context.beginPath();
    context.arc(middle, middle, scale, 0, 2 * Math.PI);
    context.stroke();
    if (!gait) {
      this.multipliers.textContent = "No periodic gait is found near here.";
      return;
    }
    for (const [re, im] of gait.multipliers) {
      const inside = Math.hypot(re, im) < 1;
      context.beginPath();
      context.arc(middle + re * scale, middle - im * scale, 6, 0, 2 * Math.PI);
      context.fillStyle = context.strokeStyle = inside ? colors.even : colors.odd;
      context.lineWidth = 2;
      if (inside) context.fill();
      else context.stroke();
    }
    const short = (x) => (Math.abs(x) < 1e-6 ? "0" : digits(x, 3).replace("-", "−"));
    const text = gait.multipliers.map(([re, im]) => `${short(re)}${im ? `${im < 0 ? " − " : " + "}${short(Math.abs(im))} i` : ""}`);
    const stable = gait.multipliers.every(([re, im]) => Math.hypot(re, im) < 1);
    const owner = this.settings.policy ? "The passive gait" : "The gait";
    this.multipliers.textContent = `${owner} is ${stable ? "stable" : "unstable"}: ${text.join(", ")}.`;
  }

  /** Runs until the element leaves the page. */
  start() {
    let before = null;
    const tick = (now) => {
      if (this.stopped || !this.root.isConnected) return;
      const elapsed = before === null ? 0 : Math.min((now - before) / 1000, LONGEST_FRAME);
      before = now;
      if (this.visible !== false && this.walk) {
        if (this.running) this.advance(elapsed);
        if (this.running || !this.drawn) this.draw();
        this.drawn = true;
      }
      requestAnimationFrame(tick);
    };
    if ("IntersectionObserver" in globalThis) {
      const seen = new IntersectionObserver(([entry]) => (this.visible = entry.isIntersecting));
      seen.observe(this.canvas);
    }
    requestAnimationFrame(tick);
  }

  stop() {
    this.stopped = true;
  }
}

/** A player of a system of one's own; `play` makes it. */
export class SystemPlayer extends Player {
  get portraitOf() {
    return `Phase portrait: the rate over each coordinate of ${this.data.name}`;
  }

  fields() {
    const { data, settings } = this;
    const ground = data.block.notes.uneven ? [labelled("Ground", this.groundChoice())] : [];
    return [
      ...ground,
      this.slider("slope", "Slope, rad", -0.02, 0.12, 0.0005),
      this.slider("speed", "Speed", SLOWEST, FASTEST, SLOWEST),
      ...data.controls.map((name) => this.slider(`control ${name}`, `${name}, held`, -0.1, 0.1)),
    ];
  }

  parameters() {
    return Object.keys(this.data.fields).map((name) => this.slider(`body ${name}`, name));
  }

  valueOf(name) {
    const [kind, ...rest] = name.split(" "), field = rest.join(" ");
    return kind === "body" ? this.walk.fields[field] : (this.settings.controls[field] ?? 0);
  }

  homeOf(name) {
    const [kind, ...rest] = name.split(" "), field = rest.join(" "), { home } = this;
    if (kind === "body") return home.changes[field] ?? this.data.fields[field];
    return kind === "control" ? (home.controls[field] ?? 0) : home[name];
  }

  rangeOf(name) {
    const own = this.data.fields[name.slice(5)];
    return own ? [Math.min(0, 2 * own), Math.max(0, 2 * own)] : [-0.5, 0.5];
  }

  showChoices() {
    if (this.grounds) this.grounds.value = this.settings.ground;
  }

  slide(name, value) {
    const [kind, ...rest] = name.split(" "), field = rest.join(" ");
    if (kind === "body") this.set({ changes: { ...this.settings.changes, [field]: value } });
    else if (kind === "control") this.set({ controls: { ...this.settings.controls, [field]: value } });
    else this.set({ [name]: value });
  }

  check() {}

  change() {
    this.walk.change({ slope: this.settings.slope, body: this.settings.changes });
  }

  async make(start) {
    const { system, slope, changes, ground } = this.settings, seed = this.settings.seed++;
    const options = { slope, body: changes, terrain: GROUNDS[ground].terrain, seed, state: start, read: this.read };
    this.walk = await createSystem(system, options);
    this.policy = null;
    const gait = start ? null : this.findGait();
    if (gait) this.walk.reset(gait.state, { seed });
  }

  findGait() {
    return this.walk.findGait({ controls: this.#controls() });
  }

  push(impulse) {
    if (this.data.block.notes.pushed) super.push(impulse);
  }

  step() {
    return this.walk.step(0.1, this.#controls()) === "HEELSTRIKE" ? this.walk.stride : null;
  }

  #controls() {
    return this.data.controls.map((name) => this.settings.controls[name] ?? 0);
  }

  measured({ step_length, step_period }) {
    return [
      ["step length", digits(step_length)],
      ["step period", `${digits(step_period)} √(l/g)`],
      ["speed", `${digits(step_length / step_period)} √(g l)`],
    ];
  }

  window(now) {
    const half = now.state.length / 2, states = [...this.trail, now].map(({ state }) => state);
    const most = (first) => Math.max(0.1, ...states.map((state) => Math.max(...state.slice(first, first + half).map(Math.abs))));
    return [0, half].map((first) => Number((1.1 * most(first)).toPrecision(2)));
  }

  curves({ state }) {
    const half = state.length / 2;
    return Array.from({ length: half }, (_, i) => [state[i], state[half + i]]);
  }
}

const PLAYS = ["read", "share", "compact", "paused", "onstate"];
const PLAYS_WALKER = ["walker", "changes", "slope", "torque", "policy", "ground", "speed", "start", "seed"];
const PLAYS_SYSTEM = ["system", "changes", "slope", "controls", "ground", "speed", "start", "seed"];

/** Refuses options that `play` would ignore, and names of what there is not. */
function checkOptions(options, names) {
  const known = [...(options.system ? PLAYS_SYSTEM : PLAYS_WALKER), ...PLAYS];
  const strange = Object.keys(options).filter((name) => !known.includes(name));
  if (strange.length) throw new Error(`play has no ${strange.join(", ")} here; it has ${known.join(", ")}`);
  if (options.policy && options.torque) throw new Error(`the policy ${options.policy} works the motor: leave out torque`);
  for (const [name, among] of Object.entries({ ground: GROUNDS, ...names })) {
    const value = options[name];
    if (value !== undefined && value !== "" && !Object.hasOwn(among, value)) {
      throw new Error(`no ${name} ${value}: choose from ${Object.keys(among).join(", ")}`);
    }
  }
}

/** Settings from a page's address. */
export function settingsFrom(hash, data) {
  const given = Object.fromEntries(new URLSearchParams(hash.replace(/^#/, "")));
  const settings = {}, changes = {};
  for (const [name, value] of Object.entries(given)) {
    const number = Number(value);
    if (name === "walker" && Object.hasOwn(data.walkers, value)) settings.walker = value;
    else if (name === "policy" && Object.hasOwn(data.policies, value)) settings.policy = value;
    else if (name === "ground" && Object.hasOwn(GROUNDS, value)) settings.ground = value;
    else if (["slope", "torque", "speed"].includes(name) && Number.isFinite(number)) settings[name] = number;
    else if (data.parameters.includes(name) && Number.isFinite(number)) changes[name] = number;
  }
  return withPolicy(Object.keys(changes).length ? { ...settings, changes } : settings, data);
}

/**
 * Shows a walker in an element, with all controls.
 *
 * @param options `system`, the name of a system of one's own, or `walker`; `slope`, `torque`, `ground`, `speed`, `changes` of the walker's
 *   parameters; `policy`, which has its own walker and slope unless they are given, and no `torque`; `start` on the Poincaré section; `share` writes settings to the page's address;
 *   `compact` hides the plots; `paused`; `read` reads the package's files; `onstate` is called after
 *   each control step and each change of the settings.
 */
export async function play(root, options = {}) {
  const { read = readFile, share = false, compact = false, paused, onstate, ...settings } = options;
  try {
    if (settings.system) {
      checkOptions(options, {});
      const first = await createSystem(settings.system, { read });
      const own = { slope: first.slope, controls: {}, ...settings };
      const player = new SystemPlayer(root, first, { settings: own, read, compact, paused, onstate });
      await player.begin();
      player.start();
      return player;
    }
    const data = await library(read);
    checkOptions(options, { walker: data.walkers, policy: data.policies });
    const own = share ? settingsFrom(location.hash, data) : {};
    const player = new Player(root, data, { settings: { ...withPolicy(settings, data), ...own }, read, share, compact, paused, onstate });
    try {
      await player.begin();
    } catch (error) {
      // An address or a caller may ask for a walker that cannot be.
      player.settings = { ...player.settings, changes: {}, policy: "", slope: 0.036, walker: "lab", start: undefined };
      await player.begin();
      player.said.textContent = error.message;
    }
    player.start();
    return player;
  } catch (error) {
    root.append(element("p", { role: "alert" }, `The walker cannot be shown here: ${error.message}`));
    throw error;
  }
}
