// Figures to explore: a branch of gaits, a basin of attraction, a bifurcation diagram.
//
//     import { explore } from "./explore.js";
//     await explore(document);
//
// An element `data-figure="family"` becomes that figure; `#explore-player` shows the chosen walks.

import { create } from "./passive-walker/passive-walker.js";
import { play } from "./passive-walker/player.js";

const MARGIN = { left: 66, right: 14, top: 14, bottom: 46 }; // CSS pixels
const HEIGHT = 0.58; // of the width
const CLICK = 6; // pixels that a click may move
const ZOOM = 1.6; // of a key or a button
const MOST_ZOOM = 60;
const FINEST = 65535;
const CODES = 32; // a basin's code is this times the kind of the end, plus strides

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

const digits = (x, places = 4) => Number(x.toPrecision(places)).toString().replace("-", "−");
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

/** Round numbers for the marks of an axis. */
function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= raw);
  const found = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) found.push(i * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

/** The least and the largest of some numbers, and a margin. */
function extent(values, margin = 0.04) {
  let low = Infinity, high = -Infinity;
  for (const x of values) [low, high] = [Math.min(low, x), Math.max(high, x)];
  return [low - margin * (high - low), high + margin * (high - low)];
}

/**
 * A figure with a cursor, zoom and a chosen walk.
 *
 * A subclass has `whole` = [[x, x], [y, y]], `labels`, `draw(context, place)`, `near(x, y, scale)`,
 * `at(item)` with its place and its text, `step(item, key)`, and `walk(item)`, settings of a player.
 */
class Figure {
  constructor(root, title, show) {
    this.root = root;
    this.show = show;
    this.touches = new Map();
    this.canvas = element("canvas", {
      tabindex: 0, role: "application",
      "aria-label": `${title}. Arrow keys move the cursor, Enter starts the walk there, plus and minus zoom, 0 shows the whole.`,
      onkeydown: (event) => this.#key(event), onpointerdown: (event) => this.#press(event),
      onpointermove: (event) => this.#move(event), onpointerup: (event) => this.#release(event),
      onpointercancel: (event) => this.touches.delete(event.pointerId), onfocus: () => this.#aim(this.item ?? this.first),
    });
    this.canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    this.said = element("p", { class: "pw-said", role: "status", "aria-live": "polite" });
    const button = (text, act) => element("button", { type: "button", onclick: act }, text);
    this.tools = element(
      "div", { class: "pw-buttons" },
      button("Start this walk", () => this.start()), button("Zoom in", () => this.zoom(ZOOM)),
      button("Zoom out", () => this.zoom(1 / ZOOM)), button("Whole figure", () => this.reset()),
    );
    root.classList.add("pw");
    root.replaceChildren(this.canvas, this.said, this.tools);
  }

  /** Shows the figure; a subclass calls it when its data are there. */
  ready(first) {
    this.first = first;
    this.reset();
    // Drawing changes the height; within an observer that is an error of the page.
    new ResizeObserver(() => requestAnimationFrame(() => this.redraw())).observe(this.canvas);
    new MutationObserver(() => this.redraw()).observe(document.body, { attributes: true, attributeFilter: ["data-theme"] });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  reset() {
    this.view = this.whole.map((range) => [...range]);
    this.redraw();
  }

  get zoomed() {
    return (this.whole[0][1] - this.whole[0][0]) / (this.view[0][1] - this.view[0][0]);
  }

  /** Magnifies by a factor around a place, the cursor's if none is given. */
  zoom(factor, place = null) {
    const cursor = this.item === undefined ? null : this.at(this.item);
    const inside = cursor && [cursor.x, cursor.y].every((x, k) => x >= this.view[k][0] && x <= this.view[k][1]);
    const about = place ?? (inside ? [cursor.x, cursor.y] : this.view.map(([a, b]) => 0.5 * (a + b)));
    const share = Math.max(1 / factor, this.zoomed / MOST_ZOOM);
    this.view = this.view.map(([a, b], k) => [about[k] + share * (a - about[k]), about[k] + share * (b - about[k])]);
    this.#keepInside();
  }

  #keepInside() {
    if (this.zoomed <= 1) return this.reset();
    this.view = this.view.map(([a, b], k) => {
      const [low, high] = this.whole[k], shift = Math.max(0, low - a) - Math.max(0, b - high);
      return [a + shift, b + shift];
    });
    this.redraw();
  }

  /** The place of a pointer in the figure's units. */
  #placeOf(event) {
    const box = this.canvas.getBoundingClientRect();
    const x = (event.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
    const y = 1 - (event.clientY - box.top - MARGIN.top) / (box.height - MARGIN.top - MARGIN.bottom);
    return [x, y].map((share, k) => this.view[k][0] + share * (this.view[k][1] - this.view[k][0]));
  }

  /** Moves the cursor to an item and says what is there. */
  #aim(item) {
    this.item = item;
    this.said.textContent = this.at(item).text;
    this.redraw();
  }

  #key(event) {
    const act = {
      "+": () => this.zoom(ZOOM), "=": () => this.zoom(ZOOM), "-": () => this.zoom(1 / ZOOM), 0: () => this.reset(),
      Enter: () => this.start(), " ": () => this.start(),
    }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey || !(act || event.key.startsWith("Arrow"))) return;
    event.preventDefault();
    event.stopPropagation();
    if (act) return act();
    this.#aim(this.step(this.item ?? this.first, event.key.slice(5), event.shiftKey ? 10 : 1));
    const { x, y } = this.at(this.item);
    this.view = this.view.map(([a, b], k) => {
      const shift = Math.min(0, [x, y][k] - a) + Math.max(0, [x, y][k] - b);
      return [a + shift, b + shift];
    });
    this.redraw();
  }

  #scale() {
    return this.view.map(([a, b], k) => [this.canvas.clientWidth, this.canvas.clientHeight][k] / (b - a));
  }

  #press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.touches.set(event.pointerId, event);
    this.pressed = this.touches.size === 1 ? event : null;
  }

  #move(event) {
    const before = this.touches.get(event.pointerId);
    if (!before) {
      if (event.pointerType === "mouse") this.#aim(this.near(...this.#placeOf(event), this.#scale()));
      return;
    }
    const middle = () => {
      const all = [...this.touches.values()];
      return { clientX: all.reduce((sum, each) => sum + each.clientX, 0) / all.length, clientY: all.reduce((sum, each) => sum + each.clientY, 0) / all.length };
    };
    const apart = () => {
      const [a, b] = [...this.touches.values()];
      return b ? Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) : 1;
    };
    const [from, wide] = [this.#placeOf(middle()), apart()];
    this.touches.set(event.pointerId, event);
    if (this.pressed && this.#still(event)) return this.touches.set(event.pointerId, before);
    this.pressed = null;
    const to = this.#placeOf(middle());
    if (this.zoomed > 1) this.view = this.view.map(([a, b], k) => [a + from[k] - to[k], b + from[k] - to[k]]);
    if (this.touches.size > 1) this.zoom(apart() / Math.max(wide, 1), from);
    else this.#keepInside();
  }

  #still(event) {
    return Math.hypot(event.clientX - this.pressed.clientX, event.clientY - this.pressed.clientY) < CLICK;
  }

  #release(event) {
    const clicked = this.pressed && this.#still(event);
    this.touches.delete(event.pointerId);
    this.pressed = null;
    if (!clicked) return;
    this.#aim(this.near(...this.#placeOf(event), this.#scale()));
    this.start();
  }

  /** Zooms by the wheel with Ctrl, as pinching on a touchpad does; the wheel alone scrolls. */
  #wheel(event) {
    if (!event.ctrlKey) return;
    event.preventDefault();
    this.zoom(Math.exp(-0.01 * event.deltaY), this.#placeOf(event));
  }

  /** Starts the walk under the cursor in the player. */
  async start() {
    if (this.item === undefined) this.#aim(this.first);
    await this.show(this, await this.walk(this.item));
  }

  redraw() {
    const { canvas } = this, width = canvas.clientWidth || 640, dots = globalThis.devicePixelRatio || 1;
    const height = Math.round(width * HEIGHT);
    canvas.width = Math.round(width * dots);
    canvas.height = Math.round(height * dots);
    canvas.style.touchAction = this.zoomed > 1 ? "none" : "pan-y";
    const style = getComputedStyle(this.root), context = canvas.getContext("2d");
    const names = ["background", "ground", "mark", "even", "odd", "body", "push", "text"];
    this.colors = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--pw-${name}`).trim()]));
    context.setTransform(dots, 0, 0, dots, 0, 0);
    context.fillStyle = this.colors.background;
    context.fillRect(0, 0, width, height);
    const box = [MARGIN.left, MARGIN.top, width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
    const [[x0, x1], [y0, y1]] = this.view;
    const place = (x, y) => [box[0] + ((x - x0) / (x1 - x0)) * box[2], box[1] + (1 - (y - y0) / (y1 - y0)) * box[3]];
    context.save();
    context.beginPath();
    context.rect(...box);
    context.clip();
    this.draw(context, place);
    this.#drawCursor(context, place);
    context.restore();
    this.#drawAxes(context, place, box);
  }

  #drawCursor(context, place) {
    if (this.item === undefined) return;
    const { x, y } = this.at(this.item);
    context.strokeStyle = this.colors.push;
    context.lineWidth = 2.5;
    context.beginPath();
    context.arc(...place(x, y), 7, 0, 2 * Math.PI);
    context.stroke();
  }

  #drawAxes(context, place, [left, top, width, height]) {
    const [[x0, x1], [y0, y1]] = this.view;
    context.strokeStyle = context.fillStyle = this.colors.ground;
    context.lineWidth = 1;
    context.strokeRect(left, top, width, height);
    context.fillStyle = this.colors.text;
    context.font = "13px system-ui, sans-serif";
    context.textAlign = "center";
    const [xs, digitsOfX] = ticks(x0, x1, Math.max(2, width / 90));
    for (const x of xs) {
      const [at] = place(x, y0);
      context.fillRect(at, top + height, 1, 5);
      context.fillText(x.toFixed(digitsOfX).replace("-", "−"), at, top + height + 19);
    }
    context.fillText(this.labels[0], left + width / 2, top + height + 39);
    context.textAlign = "right";
    const [ys, digitsOfY] = ticks(y0, y1, Math.max(2, height / 50));
    for (const y of ys) {
      const [, at] = place(x0, y);
      context.fillRect(left - 5, at, 5, 1);
      context.fillText(y.toFixed(digitsOfY).replace("-", "−"), left - 8, at + 4);
    }
    context.save();
    context.translate(14, top + height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(this.labels[1], 0, 0);
    context.restore();
  }
}

/** The number of the nearest of some points; `scale` is pixels per unit. */
function nearest(count, xs, ys, x, y, [sx, sy]) {
  let best = 0, least = Infinity;
  for (let i = 0; i < count; i++) {
    const apart = ((xs(i) - x) * sx) ** 2 + ((ys(i) - y) * sy) ** 2;
    if (apart < least) [best, least] = [i, apart];
  }
  return best;
}

const QUANTITIES = {
  stance_angle: "stance angle just after heelstrike, rad",
  speed: "speed, √(g l)",
  multiplier: "largest Floquet multiplier, modulus",
};

/** A branch of gaits over slopes. */
class Family extends Figure {
  constructor(root, data, show) {
    super(root, "Gaits of the laboratory's walker over slopes", show);
    this.data = data;
    const options = Object.entries(QUANTITIES).map(([name, text]) => element("option", { value: name }, text));
    const select = element("select", { onchange: () => this.choose(select.value) }, ...options);
    this.tools.append(element("label", { class: "explore-choice" }, "Vertical axis ", select));
    this.choose("stance_angle");
    this.ready(data.stable.indexOf(true));
  }

  choose(name) {
    this.quantity = name;
    this.labels = ["slope, rad", QUANTITIES[name]];
    this.whole = [extent(this.data.slope), extent(this.data[name])];
    this.reset();
  }

  draw(context, place) {
    const { slope, stable, marks } = this.data, ys = this.data[this.quantity];
    for (let i = 1; i < slope.length; i++) {
      const firm = stable[i] && stable[i - 1];
      context.strokeStyle = firm ? this.colors.even : this.colors.odd;
      context.lineWidth = firm ? 4 : 2;
      context.setLineDash(firm ? [] : [6, 4]);
      context.beginPath();
      context.moveTo(...place(slope[i - 1], ys[i - 1]));
      context.lineTo(...place(slope[i], ys[i]));
      context.stroke();
    }
    context.setLineDash([]);
    context.fillStyle = this.colors.body;
    for (const [, i] of marks) {
      const [x, y] = place(slope.at(i), ys.at(i));
      context.fillRect(x - 4, y - 4, 8, 8);
    }
  }

  near(x, y, scale) {
    const { slope } = this.data, ys = this.data[this.quantity];
    return nearest(slope.length, (i) => slope[i], (i) => ys[i], x, y, scale);
  }

  at(i) {
    const { slope, stable, multiplier, marks } = this.data, y = this.data[this.quantity][i];
    const named = marks.filter(([, place]) => (place + slope.length) % slope.length === i).map(([name]) => `; ${name}`);
    const value = this.quantity === "multiplier" ? "" : `, ${QUANTITIES[this.quantity].replace(/,.*/, "")} ${digits(y)}`;
    const text = `Slope ${digits(slope[i])} rad${value}: ${stable[i] ? "stable" : "unstable"}, largest multiplier ${digits(multiplier[i], 3)}${named.join("")}.`;
    return { x: slope[i], y, text };
  }

  step(i, key, count) {
    const by = key === "Right" || key === "Up" ? count : -count;
    return Math.min(Math.max(i + by, 0), this.data.slope.length - 1);
  }

  walk(i) {
    return { walker: this.data.walker, slope: this.data.slope[i], start: this.data.state[i] };
  }
}

/** The basin of attraction of a gait on a slice of the Poincaré section. */
class Basin extends Figure {
  constructor(root, data, show) {
    super(root, "Initial states of the simplest walker, and how its walks end", show);
    this.data = data;
    this.codes = bytes(data.codes);
    this.labels = ["stance angle just after heelstrike, rad", "stance angular velocity, √(g/l)"];
    this.size = data.angles.length;
    const [a, b] = [data.angles, data.rates].map((row) => [row[0], row[row.length - 1]]);
    this.half = [a, b].map(([low, high]) => (0.5 * (high - low)) / (this.size - 1));
    this.whole = [a, b].map(([low, high], k) => [low - this.half[k], high + this.half[k]]);
    this.ready(this.near(data.gait[0], data.gait[3]));
  }

  /** The cells as a picture, in the colours of the page. */
  #cells() {
    const key = JSON.stringify(this.colors);
    if (this.painted === key) return this.picture;
    const [n, picture] = [this.size, element("canvas", { width: this.size, height: this.size })];
    const context = picture.getContext("2d"), image = context.createImageData(n, n);
    const rgb = (color) => [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16));
    const { background, even, odd, mark } = this.colors, base = rgb(background);
    const kinds = [even, odd, mark, mark].map(rgb);
    this.codes.forEach((code, i) => {
      const kind = Math.floor(code / CODES), strides = code % CODES;
      // The longer a walk that falls, the stronger is its colour.
      const share = kind ? 0.1 + 0.6 * Math.min(1, strides / 12) : 1;
      const at = 4 * ((n - 1 - Math.floor(i / n)) * n + (i % n));
      kinds[kind].forEach((x, k) => (image.data[at + k] = Math.round(share * x + (1 - share) * base[k])));
      image.data[at + 3] = 255;
    });
    context.putImageData(image, 0, 0);
    [this.picture, this.painted] = [picture, key];
    return picture;
  }

  draw(context, place) {
    const [[x0, x1], [y0, y1]] = this.whole, [left, top] = place(x0, y1), [right, bottom] = place(x1, y0);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.#cells(), left, top, right - left, bottom - top);
    const [x, y] = place(this.data.gait[0], this.data.gait[3]);
    context.strokeStyle = this.colors.text;
    context.lineWidth = 2;
    context.beginPath();
    for (const [a, b] of [[-7, 0], [7, 0], [0, -7], [0, 7]]) {
      context.moveTo(x, y);
      context.lineTo(x + a, y + b);
    }
    context.stroke();
  }

  near(x, y) {
    const index = (value, k) => Math.round((value - this.whole[k][0]) / (2 * this.half[k]) - 0.5);
    const [i, j] = [x, y].map((value, k) => Math.min(Math.max(index(value, k), 0), this.size - 1));
    return j * this.size + i;
  }

  at(item) {
    const { angles, rates, kinds } = this.data, code = this.codes[item], strides = code % CODES;
    const x = angles[item % this.size], y = rates[Math.floor(item / this.size)], kind = Math.floor(code / CODES);
    const most = strides === CODES - 1 ? " or more" : "";
    const text = `Stance angle ${digits(x)} rad, angular velocity ${digits(y)} √(g/l): ${kinds[kind]} after ${strides}${most} strides.`;
    return { x, y, text };
  }

  step(item, key, count) {
    const [i, j] = [item % this.size, Math.floor(item / this.size)], by = { Left: [-1, 0], Right: [1, 0], Up: [0, 1], Down: [0, -1] }[key];
    const [a, b] = [i + by[0] * count, j + by[1] * count].map((x) => Math.min(Math.max(x, 0), this.size - 1));
    return b * this.size + a;
  }

  walk(item) {
    const { x, y } = this.at(item), swing = this.data.ratios[item % this.size] * y;
    return { walker: this.data.walker, slope: this.data.slope, start: [x, -x, -x, y, swing, swing] };
  }
}

/** Stance angles of settled walks over slopes. */
class Bifurcation extends Figure {
  constructor(root, data, show) {
    super(root, "Stance angles of the simplest walker's settled walks over slopes", show);
    this.data = data;
    this.labels = ["slope, rad", "stance angle just after heelstrike, rad"];
    const [low, high] = data.range;
    this.angles = Float64Array.from(new Uint16Array(bytes(data.angles).buffer), (x) => low + ((high - low) * x) / FINEST);
    this.whole = [extent(data.slope), extent(data.range)];
    this.ready(0);
  }

  draw(context, place) {
    const { slope, count } = this.data, [[x0, x1]] = this.view, size = Math.min(3, 0.9 + 0.1 * this.zoomed);
    context.fillStyle = this.colors.even;
    slope.forEach((x, i) => {
      if (x < x0 || x > x1) return;
      for (let k = 0; k < count; k++) {
        const [px, py] = place(x, this.angles[i * count + k]);
        context.fillRect(px - size / 2, py - size / 2, size, size);
      }
    });
  }

  near(x, y, scale) {
    const { slope, count } = this.data;
    return nearest(this.angles.length, (i) => slope[Math.floor(i / count)], (i) => this.angles[i], x, y, scale);
  }

  at(item) {
    const { slope, period, count } = this.data, i = Math.floor(item / count), y = this.angles[item];
    const kind = period[i] ? `period ${period[i]}` : "no period up to 32 strides";
    return { x: slope[i], y, text: `Slope ${digits(slope[i], 5)} rad, stance angle ${digits(y)} rad: ${kind}.` };
  }

  step(item, key, count) {
    const each = this.data.count, column = Math.floor(item / each), y = this.angles[item];
    if (key === "Left" || key === "Right") {
      const next = Math.min(Math.max(column + (key === "Right" ? count : -count), 0), this.data.slope.length - 1);
      return next * each + nearest(each, () => 0, (k) => this.angles[next * each + k], 0, y, [0, 1]);
    }
    const way = key === "Up" ? 1 : -1, gap = (k) => way * (this.angles[column * each + k] - y);
    let best = item;
    for (let k = 0; k < each; k++) {
      // Angles of one periodic walk differ by rounding; these are one point of the figure.
      if (gap(k) > 1e-5 && (best === item || gap(k) < gap(best - column * each))) best = column * each + k;
    }
    return best;
  }

  /** Walks on the attractor to the stride of the chosen stance angle. */
  async walk(item) {
    const { walker, slope, state, count } = this.data, i = Math.floor(item / count);
    const walk = await create(walker, { slope: slope[i], max_hip_torque: 0 });
    let start = state[i];
    for (let k = 0; k <= item % count; k++) {
      const { outcome, state: next } = walk.strideFrom(start, { tolerance: 1e-10 });
      if (outcome !== "HEELSTRIKE") break;
      start = next;
    }
    return { walker, slope: slope[i], start };
  }
}

const KINDS = { family: Family, basin: Basin, bifurcation: Bifurcation };

/**
 * Makes the figures of a page, and a player that shows the walk under a figure's cursor.
 *
 * @param page The document, or an element with the figures and the player in it.
 * @returns The figures by name, and the player.
 */
export async function explore(page) {
  const answer = await fetch(new URL("explore.json", import.meta.url));
  if (!answer.ok) throw new Error(`explore.json cannot be read: ${answer.status} ${answer.statusText}`);
  const data = await answer.json();
  const box = page.querySelector("#explore-player");
  const player = await play(box, { compact: true });
  const show = async (figure, settings) => {
    figure.root.after(box);
    await player.set({ changes: {}, policy: "", torque: 0, ground: "smooth", ...settings });
    if (!player.running && !matchMedia("(prefers-reduced-motion: reduce)").matches) player.toggle();
    player.draw();
    player.canvas.scrollIntoView({ block: "nearest" });
  };
  const figures = {};
  for (const root of page.querySelectorAll("[data-figure]")) {
    const name = root.dataset.figure;
    figures[name] = new KINDS[name](root, data[name], show);
    const still = root.nextElementSibling;
    if (still?.classList.contains("explore-still")) still.hidden = true;
  }
  return { figures, player };
}
