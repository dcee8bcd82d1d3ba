// The 3D view: world frame, z up.
import { AmbientLight, DirectionalLight, OrbitControls, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { Body } from "pardalis/body.js";
import { CameraMark } from "pardalis/cameras.js";
import { onThemeChange } from "pardalis/colors.js";
import { element } from "pardalis/dom.js";
import { extentOf } from "pardalis/extent.js";
import { Ground } from "pardalis/ground.js";

/** Directions from which the scene is seen, by name, and the key of each. */
export const VIEWS = { perspective: [0.62, -1, 0.62], above: [0, -1e-4, 1], side: [0, -1, 0.02], front: [1, 0, 0.02] };

const FIELD_OF_VIEW_DEG = 38;

/** The share of width and height that the scene fills when all of it is in view. */
const FILLED = 0.86;

/** Dashes of the trails of a second run are this share of the radius of everything. */
const DASH = 1 / 50;

/** Returns a 3D view in an element; null if the browser has no WebGL. */
export function createStage(host) {
  const canvas = element("canvas", { class: "pv-canvas", "aria-label": "3D view of the tracks", role: "img" });
  // Asked first, because three.js reports a failure as an error on the console.
  const context = canvas.getContext("webgl2", { antialias: true, alpha: true });
  return context ? new Stage(host, canvas, context) : null;
}

class Stage {
  constructor(host, canvas, context) {
    this.host = host;
    this.labels = new Map();
    this.overlay = element("div", { class: "pv-labels", "aria-hidden": "true" });
    host.append(canvas, this.overlay);
    this.renderer = new WebGLRenderer({ canvas, context, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.world = new Scene();
    this.world.add(new AmbientLight(0xffffff, 1.3));
    this.light = new DirectionalLight(0xffffff, 1.7);
    this.world.add(this.light);
    this.addLabel = (text, position, kind) => this.#addLabel(text, position, kind);
    this.ground = new Ground(this.world, this.addLabel);
    /** Those of the run, and of a second one that is compared with it. */
    this.bodies = [new Map(), new Map()];
    this.cameras = [];
    this.scene = { cameras: [], targets: [] };
    this.view = "perspective";
    this.fitted = null;
    this.resizes = new ResizeObserver(() => this.#resize());
    this.resizes.observe(host);
    this.stopThemes = onThemeChange(() => this.#rebuild());
    this.#resize();
  }

  /** Sets the scene. */
  setScene(scene) {
    this.scene = scene;
    this.#rebuild();
    this.fit();
  }

  /**
   * Shows the tracks of a run, and of a second one if there are two, as they are now. `by` is what the colours of trails mean, `shapeOf(name)` and
   * `colorOf(name, run)` give shape and colour of a target.
   */
  setTracks(runs, { by, shapeOf, colorOf }) {
    const all = runs.flatMap((tracks) => [...tracks.all.values()]);
    const extent = extentOf(this.scene, all);
    const isOutside = !this.fitted || !contains(this.fitted, extent);
    if (isOutside) this.extent = extent;
    this.bodies.forEach((bodies, run) => {
      const tracks = runs[run]?.all ?? new Map();
      for (const [name, body] of bodies) {
        if (tracks.has(name)) continue;
        body.dispose();
        bodies.delete(name);
      }
      for (const track of tracks.values()) {
        const { name } = track;
        if (!bodies.has(name)) bodies.set(name, new Body(this.world, name, shapeOf(name), run > 0 ? null : this.addLabel, run > 0));
        bodies.get(name).setTrack(track, by, colorOf(name, run), DASH * this.extent.radius);
      }
    });
    this.runs = runs;
    this.style = { by, shapeOf, colorOf };
    if (isOutside) {
      this.#rebuildSurroundings();
      if (!this.isMoved()) this.fit();
    }
  }

  /** Follows the paths of cameras, to which poses have been added. */
  setPaths() {
    const shown = this.#shownCameras();
    if (shown.length !== this.cameras.length) this.#rebuildSurroundings();
    else this.cameras.forEach((mark, at) => mark.setPath(shown[at].path ?? []));
  }

  setTime(time_s, selected) {
    this.time_s = time_s;
    for (const body of this.#allBodies()) body.setTime(time_s, this.extent?.floor ?? 0, body.name === selected);
    for (const camera of this.cameras) camera.setTime(time_s);
    this.draw();
  }

  /** Shows everything from one of the views. */
  setView(name) {
    this.view = name;
    this.fit();
  }

  fit() {
    if (!this.extent) return;
    const away = new Vector3(...VIEWS[this.view]).normalize();
    const { center, distance } = this.#frame(away);
    this.controls.target.copy(center);
    this.camera.position.copy(away.multiplyScalar(distance).add(center));
    this.camera.near = distance / 200;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.fittedFrom = this.camera.position.clone();
    this.draw();
  }

  /** Returns the point to look at and how far away from it the whole box is in view. */
  #frame(away) {
    const right = new Vector3(0, 0, 1).cross(away).normalize();
    const up = away.clone().cross(right);
    const middle = new Vector3(...this.extent.center);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
      const place = this.extent.all.map((range, axis) => range[(corner >> axis) & 1]);
      return new Vector3(...place).sub(middle);
    });
    const half = Math.tan((0.5 * FIELD_OF_VIEW_DEG * Math.PI) / 180) * FILLED;
    const center = middle.clone();
    let distance = 0;
    // Near corners look larger: the middle of what is seen is not that of the box.
    for (let round = 0; round < 4; round++) {
      const seen = corners.map((corner) => corner.clone().add(middle).sub(center));
      distance = Math.max(...seen.map((corner) => corner.dot(away) + Math.max(Math.abs(corner.dot(up)), Math.abs(corner.dot(right)) / this.camera.aspect) / half));
      for (const axis of [up, right]) {
        const slopes = seen.map((corner) => corner.dot(axis) / (distance - corner.dot(away)));
        center.addScaledVector(axis, 0.5 * (Math.min(...slopes) + Math.max(...slopes)) * distance);
      }
    }
    return { center, distance };
  }

  /** Whether the user has turned the view since it was fitted. */
  isMoved() {
    return this.fittedFrom !== undefined && this.camera.position.distanceTo(this.fittedFrom) > 1e-6 * this.fittedFrom.length();
  }

  /** Draws at the next frame of the screen. */
  draw() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      this.light.position.copy(this.camera.position).add(new Vector3(0, 0, this.extent?.radius ?? 1));
      this.light.target.position.copy(this.controls.target);
      this.light.target.updateMatrixWorld();
      this.renderer.render(this.world, this.camera);
      this.#placeLabels();
    });
  }

  #allBodies() {
    return this.bodies.flatMap((bodies) => [...bodies.values()]);
  }

  #rebuild() {
    for (const body of this.#allBodies()) body.dispose();
    for (const bodies of this.bodies) bodies.clear();
    this.fitted = null;
    if (this.runs) {
      this.setTracks(this.runs, this.style);
    } else {
      this.extent = extentOf(this.scene, []);
      this.#rebuildSurroundings();
    }
    if (this.time_s !== undefined) this.setTime(this.time_s);
    this.draw();
  }

  /** Floor and cameras, whose size depends on that of everything. */
  #rebuildSurroundings() {
    const { radius } = this.extent;
    this.fitted = this.extent;
    this.ground.set(this.extent, this.scene.units);
    this.cameras.forEach((camera) => camera.dispose());
    this.cameras = this.#shownCameras().map((camera) => new CameraMark(this.world, camera, 0.22 * radius, this.addLabel));
    if (this.time_s !== undefined) for (const camera of this.cameras) camera.setTime(this.time_s);
  }

  #shownCameras() {
    return this.scene.cameras.filter((camera) => camera.position_m || camera.path?.length || camera.footprint_m?.length);
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    const wasMoved = this.isMoved();
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (wasMoved) this.draw();
    else this.fit();
  }

  #addLabel(text, position, kind) {
    const label = element("span", { class: `pv-label ${kind}` }, text);
    this.labels.set(label, Array.isArray(position) ? new Vector3(...position) : position);
    this.overlay.append(label);
    return () => {
      this.labels.delete(label);
      label.remove();
    };
  }

  #placeLabels() {
    const { clientWidth: width, clientHeight: height } = this.host;
    const point = new Vector3();
    for (const [label, position] of this.labels) {
      point.copy(position).project(this.camera);
      const isShown = point.z < 1 && Math.abs(point.x) < 1.02 && Math.abs(point.y) < 1.02 && Number.isFinite(point.x);
      label.style.visibility = isShown ? "visible" : "hidden";
      label.style.transform = `translate(${(0.5 * (point.x + 1) * width).toFixed(1)}px, ${(0.5 * (1 - point.y) * height).toFixed(1)}px)`;
    }
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    this.resizes.disconnect();
    this.stopThemes();
    for (const body of this.#allBodies()) body.dispose();
    this.cameras.forEach((camera) => camera.dispose());
    this.ground.dispose();
    this.controls.dispose();
    this.renderer.dispose();
    this.host.replaceChildren();
  }
}

/** Whether the floor of one extent, with half of it on every side, has room for another. */
function contains(fitted, extent) {
  const near = fitted.radius * 1.5;
  const isNear = extent.center.every((component, axis) => Math.abs(component - fitted.center[axis]) + extent.radius <= near);
  return isNear && extent.radius > 0.4 * fitted.radius;
}
