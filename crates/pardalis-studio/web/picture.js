// The picture of a camera, with what is drawn over it. Points and boxes are given with the mouse or with the keyboard.

import { el } from "./elements.js";

const DRAG_PX = 6;

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
    this.canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": `Picture of camera ${name}. ${help}` });
    this.caption = el("figcaption", {}, name);
    this.element = el("figure", { class: "picture waits", "data-camera": name }, this.canvas, this.caption);
    this.canvas.addEventListener("pointerdown", (event) => this.#down(event));
    this.canvas.addEventListener("pointermove", (event) => this.#move(event));
    this.canvas.addEventListener("pointerup", (event) => this.#up(event));
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
    const zoom = canvas.width / image.width;
    context.setTransform(zoom, 0, 0, zoom, 0, 0);
    context.imageSmoothingEnabled = zoom < 3;
    context.drawImage(image, 0, 0);
    // From the corners of pixels to their centres.
    context.translate(0.5, 0.5);
    const px = ratio / zoom;
    this.draw?.(context, px, this.about);
    this.#drawPointer(context, px);
  }

  #drawPointer(context, px) {
    const box = this.drag?.isBox ? [this.drag.from, this.drag.to] : this.corner && this.cursor && [this.corner, this.cursor];
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

  #pixel({ clientX, clientY }) {
    const room = this.canvas.getBoundingClientRect();
    const scale = this.image.width / room.width;
    return [(clientX - room.left) * scale - 0.5, (clientY - room.top) * scale - 0.5];
  }

  #down(event) {
    if (!this.image || event.button !== 0 || !(this.point || this.box)) return;
    const from = this.#pixel(event);
    this.drag = { from, to: from, at: [event.clientX, event.clientY], isBox: false };
    this.canvas.setPointerCapture(event.pointerId);
  }

  #move(event) {
    if (!this.drag) return;
    const [x, y] = this.drag.at;
    this.drag.to = this.#pixel(event);
    this.drag.isBox ||= this.box && Math.hypot(event.clientX - x, event.clientY - y) > DRAG_PX;
    if (this.drag.isBox) this.redraw();
  }

  #up() {
    const { drag } = this;
    this.drag = null;
    if (!drag) return;
    if (drag.isBox) this.box([drag.from, drag.to]);
    else this.point?.(drag.from);
    this.redraw();
  }

  /** Arrows move a cross, Enter points, B begins and ends a box, Escape leaves. */
  #key(event) {
    if (!this.image || !(this.point || this.box) || event.ctrlKey || event.altKey || event.metaKey) return;
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
    this.redraw();
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
