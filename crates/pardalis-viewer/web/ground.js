// The floor with a grid in round steps, and the axes.
import { BufferAttribute, BufferGeometry, Color, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";
import { theme } from "pardalis/colors.js";
import { roundStep, tick } from "pardalis/format.js";

/** Lines across the shorter side. */
const LINES = 8;

export class Ground {
  /** `addLabel(text, position, class)` places a text in the scene, and returns a function that removes it. */
  constructor(parent, addLabel) {
    this.parent = parent;
    this.addLabel = addLabel;
    this.removals = [];
    this.group = new Group();
    parent.add(this.group);
  }

  /** Draws the floor at height `z` below a box [[x, x], [y, y]]. */
  set([[x0, x1], [y0, y1]], z, units) {
    this.clear();
    const step = roundStep(Math.max(x1 - x0, y1 - y0), LINES);
    const [left, right] = [Math.floor(x0 / step), Math.ceil(x1 / step)];
    const [near, far] = [Math.floor(y0 / step), Math.ceil(y1 / step)];
    const lines = [];
    for (let i = left; i <= right; i++) lines.push(i * step, near * step, z, i * step, far * step, z);
    for (let i = near; i <= far; i++) lines.push(left * step, i * step, z, right * step, i * step, z);
    this.#lines(lines, theme().grid);

    const floor = new PlaneGeometry((right - left) * step, (far - near) * step);
    floor.translate(0.5 * (left + right) * step, 0.5 * (near + far) * step, z - 0.002 * step);
    this.group.add(new Mesh(floor, new MeshBasicMaterial({ color: theme().ground, transparent: true, opacity: 0.85, polygonOffset: true, polygonOffsetFactor: 1 })));

    // Numbers along two sides; those of the last line give way to the name of the axis.
    for (let i = left; i < right; i++) this.#label(tick(i * step, step), [i * step, near * step - 0.25 * step, z]);
    for (let i = near; i < far; i++) this.#label(tick(i * step, step), [left * step - 0.25 * step, i * step, z]);
    this.#label(`x (${units})`, [right * step, near * step - 0.25 * step, z], "pv-axis-name");
    this.#label(`y (${units})`, [left * step - 0.25 * step, far * step, z], "pv-axis-name");
    this.#axes(step);
  }

  /** Arrows of the world frame at its origin. */
  #axes(length) {
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, number) => {
      const end = axis.map((component) => component * length);
      this.#lines([0, 0, 0, ...end], theme().axes[number]);
      this.#label("xyz"[number], end.map((component) => 1.12 * component), `pv-axis-letter pv-axis-${number}`);
    });
  }

  #label(text, position, kind = "pv-tick") {
    this.removals.push(this.addLabel(text, position, kind));
  }

  #lines(coordinates, color) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(Float32Array.from(coordinates), 3));
    this.group.add(new LineSegments(geometry, new LineBasicMaterial({ color: new Color(color) })));
  }

  clear() {
    this.removals.forEach((remove) => remove());
    this.removals = [];
    for (const child of [...this.group.children]) {
      this.group.remove(child);
      child.geometry.dispose();
      child.material.dispose();
    }
  }

  dispose() {
    this.clear();
    this.parent.remove(this.group);
  }
}
