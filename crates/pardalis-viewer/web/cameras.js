// Cameras with what they see.
import { BufferAttribute, BufferGeometry, Color, DoubleSide, Group, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, Quaternion, Vector3 } from "three";
import { theme } from "pardalis/colors.js";
import { lastAtOrBefore } from "pardalis/tracks.js";

/** The line of the way of a camera has about this many points at most. */
const MAX_POINTS = 2000;

/** A camera of the scene; see viewer.js for its keys. */
export class CameraMark {
  constructor(parent, camera, length, addLabel) {
    this.parent = parent;
    this.group = new Group();
    this.way = new Group();
    parent.add(this.group, this.way);
    const rays = bordersOf(camera.border_rays ?? [], length);
    const color = new Color(theme().camera);
    this.color = color;
    this.group.add(lines(frustumLines(rays, length), color, 0.9));
    if (rays.length > 2) this.group.add(fan(rays, color));
    if (camera.footprint_m?.length > 2) {
      const { footprint_m } = camera;
      this.way.add(lines(footprint_m.flatMap((place, at) => [...place, ...footprint_m[(at + 1) % footprint_m.length]]), color, 0.7));
    }
    this.setPath(camera.path ?? []);
    this.place = new Vector3(...(camera.footprint_m?.[0] ?? [NaN, NaN, NaN]));
    this.group.visible = false;
    this.removeLabel = addLabel(camera.name, this.place, "pv-camera-name");
    const r = camera.world_from_camera;
    if (r && camera.position_m) {
      const matrix = new Matrix4().set(...r[0], 0, ...r[1], 0, ...r[2], 0, 0, 0, 0, 1);
      this.#put(camera.position_m, new Quaternion().setFromRotationMatrix(matrix));
    }
  }

  /** Takes where a moving camera is, in order of time. */
  setPath(path) {
    if (path === this.path) return;
    this.path = path;
    this.times = path.map(([time_s]) => time_s);
    if (this.line) remove(this.way, this.line);
    const step = Math.ceil(path.length / MAX_POINTS);
    const places = path.filter((_, at) => at % step === 0 || at === path.length - 1).map((pose) => pose.slice(1, 4));
    this.line = lines(places.flatMap((place, at) => (at === 0 ? [] : [...places[at - 1], ...place])), this.color, 0.4);
    this.way.add(this.line);
  }

  /** Puts a moving camera where it is at a time in seconds. */
  setTime(time_s) {
    if (this.path.length === 0) return;
    const at = Math.max(0, lastAtOrBefore(this.times, this.times.length, time_s));
    const [, x, y, z, qw, qx, qy, qz] = this.path[at];
    this.#put([x, y, z], new Quaternion(qx, qy, qz, qw));
  }

  #put(position_m, rotation) {
    this.group.visible = true;
    this.group.position.set(...position_m);
    this.group.quaternion.copy(rotation);
    this.place.set(...position_m);
  }

  dispose() {
    this.removeLabel();
    for (const group of [this.group, this.way]) {
      this.parent.remove(group);
      for (const child of [...group.children]) remove(group, child);
    }
  }
}

function remove(group, child) {
  group.remove(child);
  child.geometry.dispose();
  child.material.dispose();
}

/** A camera with a view narrower than this, whose rays have at least this z, is drawn with a flat image: as people draw frusta. */
const FLAT_Z = 0.35;

/** The ends of the rays around an image, in metres in the camera frame. */
function bordersOf(rays, length) {
  const isFlat = rays.every((ray) => ray[2] > FLAT_Z);
  return rays.map((ray) => ray.map((component) => (component * length) / (isFlat ? ray[2] : 1)));
}

/** The border, four lines to it from the camera, and the body of the camera. */
function frustumLines(rays, length) {
  const points = [];
  rays.forEach((ray, at) => points.push(...ray, ...rays[(at + 1) % rays.length]));
  for (let corner = 0; corner < 4 && rays.length > 0; corner++) {
    points.push(0, 0, 0, ...rays[Math.floor((corner * rays.length) / 4)]);
  }
  const [w, h, d] = [0.09 * length, 0.06 * length, 0.16 * length];
  for (const z of [-d, 0]) points.push(-w, -h, z, w, -h, z, w, -h, z, w, h, z, w, h, z, -w, h, z, -w, h, z, -w, -h, z);
  for (const [x, y] of [[-w, -h], [w, -h], [w, h], [-w, h]]) points.push(x, y, -d, x, y, 0);
  return points;
}

function lines(points, color, opacity) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(Float32Array.from(points), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ color, transparent: true, opacity }));
}

function fan(rays, color) {
  const triangles = rays.flatMap((ray, at) => [0, 0, 0, ...ray, ...rays[(at + 1) % rays.length]]);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(Float32Array.from(triangles), 3));
  return new Mesh(geometry, new MeshBasicMaterial({ color, transparent: true, opacity: 0.08, side: DoubleSide, depthWrite: false }));
}
