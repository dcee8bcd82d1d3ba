// The picture of a camera, with what is drawn over it. Points and boxes are given with the mouse or with the keyboard.

import { button, el } from "./elements.js";

const DRAG_PX = 6;
/** How much a picture is magnified at most, and by a turn of the wheel or a key. */
const MOST_ZOOM = 32;
const ZOOM_STEP = 1.25;

/** How much of each camera's picture is shown, in all steps: how much it is magnified, and the middle of that as shares of its width and height. */
const views = new Map();
const WHOLE = { zoom: 1, middle: [0.5, 0.5] };

/**
 * A picture. `point([u, v])` and `box([[u, v], [u, v]])` are called, if given, for clicks and drags; pixel centres are at integers.
 * `draw(context, px, about)` draws over the image, in pixels of the image; `px` is the size of a pixel of the screen there.
 */
export class Picture {
  constructor(name, { point = null, box = null, draw = null, help = "" } = {}) {
    Object.assign(this, { name, point, box, draw });
    this.image = null;
    this.about = {};
    this.cursor = null;
    this.corner = null;
    this.drag = null;
    /** Where each finger is, and what two of them have taken: a pixel, and how far they are apart on the screen. */
    this.fingers = new Map();
    this.pinch = null;
    this.canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": `Picture of camera ${name}. Plus and minus magnify it, 0 shows all of it. ${help}` });
    this.caption = el("figcaption", {}, name);
    this.zoomed = el("span");
    const zoom = (sign, label, factor) => button(sign, () => this.#zoom(factor), { "aria-label": `${label} the picture of ${name}`, title: `${label} (mouse wheel)` });
    const whole = button(this.zoomed, () => this.#zoom(0), { class: "whole", title: "Key 0" });
    const buttons = el("div", { class: "zoom" }, whole, zoom("−", "Reduce", 1 / ZOOM_STEP ** 2), zoom("+", "Magnify", ZOOM_STEP ** 2));
    this.element = el("figure", { class: "picture waits", "data-camera": name }, this.canvas, buttons, this.caption);
    this.canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    this.canvas.addEventListener("pointerdown", (event) => this.#down(event));
    this.canvas.addEventListener("pointermove", (event) => this.#move(event));
    this.canvas.addEventListener("pointerup", (event) => this.#isPinched(event) || this.#up());
    this.canvas.addEventListener("pointercancel", (event) => this.#isPinched(event) || this.#leave());
    // With text of the page selected, browsers would drag that.
    this.canvas.addEventListener("dragstart", (event) => event.preventDefault());
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    this.canvas.addEventListener("blur", () => {
      this.cursor = this.corner = null;
      this.redraw();
    });
    this.observer = new ResizeObserver(() => this.redraw());
    this.observer.observe(this.element);
  }

  dispose() {
    this.observer.disconnect();
  }

  show(image, about) {
    this.image = image;
    this.about = about;
    this.element.classList.remove("waits");
    this.redraw();
  }

  /** Shows nothing until an image comes. */
  wait() {
    this.image = null;
    this.about = {};
    this.element.classList.add("waits");
    this.canvas.getContext("2d").reset();
  }

  /** Draws the image and what belongs over it. */
  redraw() {
    const { image, canvas } = this;
    if (!image) return;
    const room = this.element.getBoundingClientRect();
    const width = Math.max(room.width, 1);
    const height = Math.max(room.height - this.caption.offsetHeight, 1);
    const scale = Math.min(width / image.width, height / image.height);
    const ratio = window.devicePixelRatio || 1;
    const size = [image.width, image.height].map((side) => Math.max(1, Math.floor(side * scale * ratio)));
    // A new size makes a new canvas, even if it is the same.
    if (canvas.width !== size[0] || canvas.height !== size[1]) {
      canvas.style.width = `${Math.floor(image.width * scale)}px`;
      canvas.style.height = `${Math.floor(image.height * scale)}px`;
      [canvas.width, canvas.height] = size;
    }
    const context = canvas.getContext("2d");
    const { left, top, magnified } = this.#shown();
    const zoom = (magnified * canvas.width) / image.width;
    this.element.classList.toggle("magnified", magnified > 1);
    this.zoomed.textContent = `Whole picture (${magnified.toFixed(magnified < 10 ? 1 : 0)}×)`;
    context.setTransform(zoom, 0, 0, zoom, -left * zoom, -top * zoom);
    context.imageSmoothingEnabled = zoom < 3;
    context.drawImage(image, 0, 0);
    // From the corners of pixels to their centres.
    context.translate(0.5, 0.5);
    const px = ratio / zoom;
    this.draw?.(context, px, this.about);
    this.#drawPointer(context, px);
  }

  #drawPointer(context, px) {
    const box = this.drag?.isFar && !this.drag.moves ? [this.drag.from, this.drag.to] : this.corner && this.cursor && [this.corner, this.cursor];
    for (const [color, width] of [["#000a", 3.5], ["#fff", 1.5]]) {
      context.strokeStyle = color;
      context.lineWidth = width * px;
      if (box) {
        const [[u, v], [x, y]] = box;
        context.strokeRect(Math.min(u, x), Math.min(v, y), Math.abs(x - u), Math.abs(y - v));
      }
      if (this.cursor) {
        const [u, v] = this.cursor;
        context.beginPath();
        for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
          context.moveTo(u + 4 * px * x, v + 4 * px * y);
          context.lineTo(u + 14 * px * x, v + 14 * px * y);
        }
        context.stroke();
      }
    }
  }

  /** The upper left corner of what is shown, in pixels, and how much it is magnified. */
  #shown() {
    const { zoom, middle } = views.get(this.name) ?? WHOLE;
    const [left, top] = [this.image.width, this.image.height].map((side, axis) => {
      const shown = side / zoom;
      return Math.min(Math.max(middle[axis] * side - shown / 2, 0), side - shown);
    });
    return { left, top, magnified: zoom };
  }

  /** Magnifies by a factor and keeps a pixel where it is on the screen, or shows a pixel in the middle. */
  #show(factor, pixel, isMiddle = false) {
    const { left, top, magnified } = this.#shown();
    const zoom = Math.min(Math.max(factor * magnified, 1), MOST_ZOOM);
    const middle = [[left, this.image.width], [top, this.image.height]].map(([first, side], axis) => {
      const at = pixel[axis] + 0.5;
      const from = isMiddle ? 0 : (first + side / magnified / 2 - at) * (magnified / zoom);
      return (at + from) / side;
    });
    views.set(this.name, { zoom, middle });
    // What is beyond the border of the image does not count.
    const shown = this.#shown();
    views.set(this.name, { zoom, middle: [(shown.left + this.image.width / zoom / 2) / this.image.width, (shown.top + this.image.height / zoom / 2) / this.image.height] });
    this.redraw();
  }

  /** Magnifies at the cross or in the middle; a factor of 0 shows the whole picture. */
  #zoom(factor) {
    if (!this.image) return;
    const { left, top, magnified } = this.#shown();
    const middle = [left + this.image.width / magnified / 2 - 0.5, top + this.image.height / magnified / 2 - 0.5];
    this.#show(factor, this.cursor ?? middle);
  }

  #wheel(event) {
    if (!this.image || event.ctrlKey || event.deltaY === 0) return;
    event.preventDefault();
    // Touch pads send many small turns.
    const turns = event.deltaMode === 0 ? Math.min(Math.max(-event.deltaY / 100, -1), 1) : -Math.sign(event.deltaY);
    this.#show(ZOOM_STEP ** turns, this.#pixel(event));
  }

  #pixel({ clientX, clientY }) {
    const room = this.canvas.getBoundingClientRect();
    const { left, top, magnified } = this.#shown();
    const scale = this.image.width / room.width / magnified;
    return [left + (clientX - room.left) * scale - 0.5, top + (clientY - room.top) * scale - 0.5];
  }

  #down(event) {
    if (!this.image || event.button > 1) return;
    if (event.pointerType === "touch") {
      this.fingers.set(event.pointerId, event);
      this.canvas.setPointerCapture(event.pointerId);
      if (this.fingers.size > 1) {
        // What the first finger has begun is given up.
        this.#leave();
        const { middle, apart } = this.#between();
        this.pinch = { from: this.#pixel(middle), apart };
        return;
      }
    }
    const from = this.#pixel(event);
    const isMagnified = this.#shown().magnified > 1;
    const moves = isMagnified && (event.button === 1 || event.shiftKey || !this.box);
    if (!moves && (event.button === 1 || !(this.point || this.box))) return;
    if (event.button === 1) event.preventDefault();
    this.drag = { from, to: from, at: [event.clientX, event.clientY], moves, isFar: false, isPoint: event.button === 0 };
    this.canvas.setPointerCapture(event.pointerId);
  }

  /** The place on the screen between two fingers, and how far they are apart. */
  #between() {
    const [a, b] = this.fingers.values();
    const middle = { clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 };
    return { middle, apart: Math.max(Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY), 1) };
  }

  /** Magnifies as the fingers move apart, and keeps what they have taken between them. */
  #pinch() {
    if (this.fingers.size < 2) return;
    const { middle, apart } = this.#between();
    this.#show(apart / this.pinch.apart, this.#pixel(middle));
    this.pinch.apart = apart;
    this.#pan({ from: this.pinch.from, to: this.#pixel(middle) });
  }

  /** Notes that a finger has left. Returns whether it was one of those that magnify, until the last of them has left. */
  #isPinched({ pointerId }) {
    this.fingers.delete(pointerId);
    const was = this.pinch !== null;
    if (this.fingers.size === 0) this.pinch = null;
    return was;
  }

  #move(event) {
    if (this.fingers.has(event.pointerId)) this.fingers.set(event.pointerId, event);
    if (this.pinch) return this.#pinch();
    const { drag } = this;
    if (!drag) return;
    const [x, y] = drag.at;
    drag.isFar ||= (drag.moves || this.box) && Math.hypot(event.clientX - x, event.clientY - y) > DRAG_PX;
    drag.to = this.#pixel(event);
    if (!drag.isFar) return;
    if (drag.moves) this.#pan(drag);
    else this.redraw();
  }

  /** Moves the picture so that the pixel that was taken is below the pointer. */
  #pan({ from, to }) {
    const { left, top, magnified } = this.#shown();
    const middle = [left + this.image.width / magnified / 2, top + this.image.height / magnified / 2];
    this.#show(1, middle.map((at, axis) => at + from[axis] - to[axis] - 0.5), true);
  }

  #up() {
    const { drag } = this;
    this.drag = null;
    if (!drag) return;
    if (drag.isFar && !drag.moves) this.box([drag.from, drag.to]);
    else if (!drag.isFar && drag.isPoint) this.point?.(drag.from);
    this.redraw();
  }

  /** Gives up what was begun with the mouse. */
  #leave() {
    this.drag = null;
    this.redraw();
  }

  /** Plus and minus magnify, 0 shows all. Arrows move a cross, Enter points, B begins and ends a box, Escape leaves. */
  #key(event) {
    if (!this.image || event.ctrlKey || event.altKey || event.metaKey) return;
    const factor = { "+": ZOOM_STEP, "-": 1 / ZOOM_STEP, 0: 0 }[event.key];
    if (factor !== undefined) {
      event.preventDefault();
      return this.#zoom(factor);
    }
    if (!(this.point || this.box)) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const middle = [Math.round(this.image.width / 2), Math.round(this.image.height / 2)];
    if (arrows[event.key]) {
      const step = event.shiftKey ? 10 : 1;
      const limit = [this.image.width - 1, this.image.height - 1];
      const from = this.cursor ?? middle;
      this.cursor = arrows[event.key].map((direction, axis) => Math.min(Math.max(from[axis] + step * direction, 0), limit[axis]));
    } else if (event.key === "Enter" && this.cursor) {
      if (this.corner) this.box?.([this.corner, this.cursor]);
      else this.point?.(this.cursor);
      this.corner = null;
    } else if (event.key.toLowerCase() === "b" && this.box) {
      this.cursor ??= middle;
      if (this.corner) this.box([this.corner, this.cursor]);
      this.corner = this.corner ? null : this.cursor;
    } else if (event.key === "Escape" && this.cursor) {
      this.cursor = this.corner = null;
    } else {
      return;
    }
    event.preventDefault();
    this.#follow();
    this.redraw();
  }

  /** Shows the cross if it has left what is shown. */
  #follow() {
    if (!this.cursor) return;
    const { left, top, magnified } = this.#shown();
    const [u, v] = this.cursor;
    const isShown = u >= left && v >= top && u < left + this.image.width / magnified && v < top + this.image.height / magnified;
    if (!isShown) this.#show(1, this.cursor, true);
  }
}

/** Draws a closed line so that it shows on any image. */
export function drawOutline(context, px, points, color = "#fff", width = 2) {
  for (const [stroke, wide] of [["#000b", width + 2.5], [color, width]]) {
    context.strokeStyle = stroke;
    context.lineWidth = wide * px;
    context.beginPath();
    points.forEach(([u, v], i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
    context.closePath();
    context.stroke();
  }
}

/** Draws a text on a dark strip, its lower left corner at a point of the image. */
export function drawText(context, px, text, [u, v], color = "#fff") {
  context.font = `${13 * px}px system-ui, sans-serif`;
  const width = context.measureText(text).width;
  context.fillStyle = "#000a";
  context.fillRect(u - 3 * px, v - 14 * px, width + 6 * px, 18 * px);
  context.fillStyle = color;
  context.fillText(text, u, v);
}

/** Draws the marks and notes of a run: see `crates/pardalis-cli/src/tracking/watch.rs`. */
export function drawMarks(context, px, { marks = [], notes = [] }) {
  for (const { shape, color, points_px: points } of marks) {
    const rgb = `rgb(${color.join(" ")})`;
    if (shape === "dots") {
      context.fillStyle = `rgb(${color.join(" ")} / 45%)`;
      for (const point of points) if (point) context.fillRect(point[0] - px, point[1] - px, 2 * px, 2 * px);
      continue;
    }
    context.strokeStyle = rgb;
    context.lineWidth = (shape === "wide_contour" ? 4.5 : 1.8) * px;
    context.setLineDash(shape === "dashes" ? [5 * px, 6 * px] : []);
    const isClosed = shape.endsWith("contour");
    context.beginPath();
    let isDown = false;
    for (const point of isClosed ? [...points, points[0]] : points) {
      if (!point) isDown = false;
      else if (isDown) context.lineTo(...point);
      else context.moveTo(...point);
      isDown = Boolean(point);
    }
    context.stroke();
    context.setLineDash([]);
  }
  for (const { at_px: at, text, color } of notes) {
    context.strokeStyle = `rgb(${color.join(" ")})`;
    context.lineWidth = 1.5 * px;
    context.beginPath();
    context.moveTo(at[0] - 5 * px, at[1]);
    context.lineTo(at[0] + 5 * px, at[1]);
    context.moveTo(at[0], at[1] - 5 * px);
    context.lineTo(at[0], at[1] + 5 * px);
    context.stroke();
  }
  drawVerdicts(context, px, notes);
}

/** Writes beside the crosses why these places were ruled out. Where texts would overlap, that of the later test is shown. */
function drawVerdicts(context, px, notes) {
  const strips = [];
  context.font = `${12 * px}px system-ui, sans-serif`;
  for (const { at_px: [u, v], text } of notes.filter(({ why }) => why).reverse()) {
    const strip = [u + 8 * px, v - 9 * px, context.measureText(text).width + 6 * px, 17 * px];
    if (strips.some(([x, y, width, height]) => x < strip[0] + strip[2] && strip[0] < x + width && y < strip[1] + strip[3] && strip[1] < y + height)) continue;
    strips.push(strip);
    context.fillStyle = "#000a";
    context.fillRect(...strip);
    context.fillStyle = "#fff";
    context.fillText(text, strip[0] + 3 * px, v + 4 * px);
  }
}
