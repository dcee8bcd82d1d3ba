// A target: its trail, and at the present time its shape, its uncertainty and its heading.
import { BufferAttribute, BufferGeometry, Color, ConeGeometry, DoubleSide, Group, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, SphereGeometry, Vector3 } from "three";
import { theme } from "pardalis/colors.js";
import { principalAxes } from "pardalis/ellipsoid.js";
import { geometryOf, reachOf, topOf } from "pardalis/shapes.js";
import { Trail } from "pardalis/trail.js";

/** The opacity of solids and ellipsoids, and of those of a second run. */
const [SOLID, ELLIPSOID] = [[1, 0.45], [0.3, 0.15]];

export class Body {
  /** `isOther` says that it is of a second run, whose targets have no labels (`addLabel` is null). */
  constructor(parent, name, shape, addLabel, isOther) {
    this.parent = parent;
    this.name = name;
    this.shape = shape;
    this.trail = new Trail(parent, isOther);
    this.reach = reachOf(shape);
    this.top = topOf(shape);
    this.group = new Group();
    this.solid = new Mesh(geometryOf(shape), new MeshLambertMaterial({ transparent: isOther, opacity: SOLID[+isOther] }));
    this.ellipsoid = new Mesh(new SphereGeometry(1, 24, 14), new MeshBasicMaterial({ transparent: true, opacity: ELLIPSOID[+isOther], depthWrite: false, side: DoubleSide }));
    this.ellipsoid.matrixAutoUpdate = false;
    this.arrow = new Mesh(new ConeGeometry(0.25 * this.reach, 0.8 * this.reach, 20).rotateZ(-Math.PI / 2), new MeshBasicMaterial());
    this.group.add(this.solid, this.arrow);
    this.drop = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ transparent: true, opacity: 0.6 }));
    this.drop.geometry.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.drop.frustumCulled = false;
    parent.add(this.group, this.ellipsoid, this.drop);
    this.place = new Vector3(NaN, NaN, NaN);
    this.removeLabel = addLabel?.(name, this.place, "pv-target-name");
  }

  setTrack(track, by, own, dash_m) {
    this.track = track;
    this.by = by;
    this.own = own;
    this.trail.set(track, by, own, dash_m);
  }

  /** Shows the target at a time in seconds, and a line down to the floor. */
  setTime(time_s, floor, isSelected) {
    const { track } = this;
    const row = track.rowAt(time_s);
    const place = row >= 0 ? track.position(row) : null;
    this.trail.showTo(track.lastRow(time_s));
    for (const part of [this.group, this.ellipsoid, this.drop]) part.visible = place !== null;
    this.place.set(...(place ?? [NaN, NaN, NaN]));
    if (!place) return;
    const isOfState = this.by === "state" || this.by === "confidence";
    const color = new Color(isOfState ? theme().states[track.state[row]] : this.own);
    const [x, y, z] = place;
    const heading = track.heading_rad[row];
    const scale = this.shape?.kind === "sphere" && track.radius_m[row] > 0 ? track.radius_m[row] / this.shape.radius_m : 1;
    this.group.position.set(x, y, z);
    this.group.rotation.z = Number.isFinite(heading) ? heading : 0;
    this.solid.scale.setScalar(scale);
    this.solid.material.color = color;
    this.solid.material.emissive = color.clone().multiplyScalar(isSelected ? 0.25 : 0.05);
    this.arrow.visible = Number.isFinite(heading);
    this.arrow.position.set(1.6 * this.reach, 0, this.top);
    this.arrow.material.color = color;
    this.place.z += this.top + 0.25 * this.reach;
    this.drop.geometry.attributes.position.array.set([x, y, z, x, y, floor]);
    this.drop.geometry.attributes.position.needsUpdate = true;
    this.drop.material.color = color;
    this.#setCovariance(row, color);
  }

  #setCovariance(row, color) {
    const { track } = this;
    const axes = principalAxes(["xx_m2", "xy_m2", "xz_m2", "yy_m2", "yz_m2", "zz_m2"].map((entry) => track[entry][row]));
    this.ellipsoid.visible = axes !== null;
    if (!axes) return;
    // On a plane there is no height to be uncertain of; a thin disc is left of the ellipsoid.
    const largest = 2 * Math.sqrt(Math.max(...axes.values));
    const basis = axes.vectors.map((vector, at) => {
      const length = Math.max(2 * Math.sqrt(axes.values[at]), 0.01 * largest);
      return new Vector3(...vector).multiplyScalar(length);
    });
    this.ellipsoid.matrix.copy(new Matrix4().makeBasis(...basis).setPosition(track.x_m[row], track.y_m[row], track.z_m[row]));
    this.ellipsoid.matrixWorldNeedsUpdate = true;
    this.ellipsoid.material.color = color;
  }

  dispose() {
    this.removeLabel?.();
    this.trail.dispose();
    for (const part of [this.solid, this.ellipsoid, this.arrow, this.drop]) {
      part.geometry.dispose();
      part.material.dispose();
    }
    this.parent.remove(this.group, this.ellipsoid, this.drop);
  }
}
