// How large everything is: what the view shows at first.
import { roundStep } from "pardalis/format.js";
import { reachOf } from "pardalis/shapes.js";

/** The share of positions at either end of each axis that does not count, because some may be far off. */
const OUTLIERS = 0.005;

/** Positions looked at, evenly spaced. */
const SAMPLES = 5000;

/** Cameras farther away than this many sizes of the tracks are not in view at first. */
const FAR = 5;

/** Lines of the floor across its longer side. */
const LINES = 8;

/** Takes a list of tracks. Returns the box of the floor [[x, x], [y, y]] in whole steps of its grid, the step, its height, the box of everything, and centre and radius of a sphere around everything. */
export function extentOf(scene, tracks) {
  const places = positionsOf(tracks);
  const axes = [0, 1, 2].map((axis) => {
    const sorted = places.map((place) => place[axis]).sort((a, b) => a - b);
    if (sorted.length === 0) return null;
    const cut = Math.floor(OUTLIERS * sorted.length);
    return [sorted[cut], sorted[sorted.length - 1 - cut]];
  });
  const reach = Math.max(0, ...scene.targets.map((target) => reachOf(target.shape)));
  let box = axes[0] && axes.map(([low, high]) => [low - 2 * reach, high + 2 * reach]);
  const fixed = scene.cameras.flatMap((camera) => [
    ...(camera.position_m ? [camera.position_m] : []),
    ...evenly(camera.path ?? [], 100).map((pose) => pose.slice(1, 4)),
    ...(box ? [] : (camera.footprint_m ?? [])),
  ]);
  const size = box ? Math.max(...box.map(([low, high]) => high - low)) : Infinity;
  const isNear = (place) => !box || Math.hypot(...place.map((component, axis) => component - 0.5 * (box[axis][0] + box[axis][1]))) < FAR * size;
  for (const place of fixed.filter(isNear)) {
    box ??= place.map((component) => [component, component]);
    box = box.map(([low, high], axis) => [Math.min(low, place[axis]), Math.max(high, place[axis])]);
  }
  box ??= [[-1, 1], [-1, 1], [0, 1]];
  // A camera alone has no size.
  if (!axes[0]) box = box.map(([low, high], axis) => (axis < 2 ? [Math.min(low, high - 1), Math.max(high, low + 1)] : [low, high]));
  // The ground at z = 0, unless everything is far from it.
  const tall = Math.max(...box.map(([low, high]) => high - low), 1e-3);
  const isOnGround = box[2][0] > -0.5 * tall && box[2][0] < 1.5 * tall;
  const floor = isOnGround ? Math.min(0, box[2][0]) : box[2][0];
  box[2][0] = Math.min(box[2][0], floor);
  const smallest = 0.25 * tall;
  const padded = [0, 1].map((axis) => {
    const [low, high] = box[axis];
    const missing = Math.max(0, smallest - (high - low)) / 2 + 0.04 * tall;
    return [low - missing, high + missing];
  });
  const step = roundStep(Math.max(...padded.map(([low, high]) => high - low)), LINES);
  const floorBox = padded.map(([low, high]) => [Math.floor(low / step) * step, Math.ceil(high / step) * step]);
  const all = [...floorBox, box[2]];
  const center = all.map(([low, high]) => 0.5 * (low + high));
  const radius = 0.5 * Math.hypot(...all.map(([low, high]) => high - low));
  return { box: floorBox, step, floor, all, center, radius: Math.max(radius, 1e-3) };
}

function positionsOf(tracks) {
  const places = [];
  let rows = 0;
  for (const track of tracks) rows += track.length;
  const step = Math.max(1, Math.floor(rows / SAMPLES));
  for (const track of tracks) {
    for (let row = 0; row < track.length; row += step) {
      const place = track.position(row);
      if (place) places.push(place);
    }
  }
  return places;
}

function evenly(list, count) {
  const step = Math.max(1, Math.floor(list.length / count));
  return list.filter((_, at) => at % step === 0);
}
