// The floor with a grid in round steps, and the axes.
import { BufferAttribute, BufferGeometry, Color, Group, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";
import { theme } from "pardalis/colors.js";
import { tick } from "pardalis/format.js";

export class Ground {
  /** `addLabel(text, position, class)` places a text in the scene, and returns a function that removes it. */
  constructor(parent, addLabel) {
    this.parent = parent;
    this.addLabel = addLabel;
    this.removals = [];
    this.group = new Group();
    parent.add(this.group);
  }

  /** Draws the floor of an extent. */
  set({ box: [[x0, x1], [y0, y1]], step, floor: z }, units) {
    this.clear();
    const [left, right, near, far] = [x0, x1, y0, y1].map((edge) => Math.round(edge / step));
    const lines = [];
    for (let i = left; i <= right; i++) lines.push(i * step, near * step, z, i * step, far * step, z);
    for (let i = near; i <= far; i++) lines.push(left * step, i * step, z, right * step, i * step, z);
    this.#lines(lines, theme().grid);

    const floor = new PlaneGeometry((right - left) * step, (far - near) * step);
    floor.translate(0.5 * (left + right) * step, 0.5 * (near + far) * step, z);
    // It hides nothing, so that what lies on it is drawn whole.
    const ground = new Mesh(floor, new MeshBasicMaterial({ color: theme().ground, transparent: true, opacity: 0.85, depthWrite: false }));
    ground.renderOrder = -2;
    this.group.add(ground);

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
    const lines = new LineSegments(geometry, new LineBasicMaterial({ color: new Color(color), transparent: true, depthWrite: false }));
    lines.renderOrder = -1;
    this.group.add(lines);
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
