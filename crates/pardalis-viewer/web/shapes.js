// Targets in their true shape and size, in metres (pixels if the plane is the image), z up, the origin at what tracks.csv calls the position.
import { BoxGeometry, CylinderGeometry, ExtrudeGeometry, Shape, SphereGeometry } from "three";

/** Without a known shape: a small ball. */
const UNKNOWN = { kind: "sphere", radius_m: 0.05 };

/** Flat shapes are drawn this thick, relative to their size. */
const THICKNESS = 0.02;

/** Returns the geometry of a shape; see viewer.js for its keys. */
export function geometryOf(shape = UNKNOWN) {
  switch (shape.kind) {
    case "cylinder":
      return upright(new CylinderGeometry(shape.radius_m, shape.radius_m, shape.height_m, 48), 0.5 * shape.height_m);
    case "prism":
      return prism(shape);
    case "box":
      return new BoxGeometry(...shape.size_m).translate(0, 0, 0.5 * shape.size_m[2]);
    case "disc": {
      const thickness = THICKNESS * shape.radius_m;
      return upright(new CylinderGeometry(shape.radius_m, shape.radius_m, thickness, 48), shape.height_m);
    }
    case "rectangle": {
      const thickness = THICKNESS * Math.max(...shape.size_m);
      return new BoxGeometry(...shape.size_m, thickness).translate(0, 0, shape.height_m);
    }
    default:
      return new SphereGeometry(shape.radius_m ?? UNKNOWN.radius_m, 28, 18);
  }
}

/** Returns the height of the top of a shape above its position, in metres. */
export function topOf(shape = UNKNOWN) {
  return shape.height_m ?? shape.size_m?.[2] ?? reachOf(shape);
}

/** Returns half the width of a shape, in metres. */
export function reachOf(shape = UNKNOWN) {
  return shape.radius_m ?? 0.5 * Math.max(...(shape.size_m ?? [shape.across_flats_m]));
}

/** Cylinders of three.js stand along y. */
function upright(geometry, middle_m) {
  return geometry.rotateX(Math.PI / 2).translate(0, 0, middle_m);
}

function prism({ sides, across_flats_m, rotation_rad, height_m }) {
  const radius_m = (0.5 * across_flats_m) / Math.cos(Math.PI / sides);
  const section = new Shape();
  for (let corner = 0; corner < sides; corner++) {
    const angle = rotation_rad + (2 * Math.PI * corner) / sides;
    section[corner ? "lineTo" : "moveTo"](radius_m * Math.cos(angle), radius_m * Math.sin(angle));
  }
  section.closePath();
  return new ExtrudeGeometry(section, { depth: height_m, bevelEnabled: false });
}
