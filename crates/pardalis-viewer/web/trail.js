// The way of a target through the scene: bright as far as the present time, faint after it.
import { Color, LineMaterial, LineSegments2, LineSegmentsGeometry, SRGBColorSpace } from "three";
import { confidenceColor, theme } from "pardalis/colors.js";
import { lastAtOrBefore } from "pardalis/tracks.js";

/** More points of a trail are thinned: several a pixel. */
const MAX_POINTS = 10000;

export class Trail {
  /** Those of a second run are dashed. */
  constructor(parent, isDashed) {
    this.parent = parent;
    this.isDashed = isDashed;
    this.endRows = [];
    this.lines = [0.22, 1].map((opacity) => {
      const material = new LineMaterial({ linewidth: opacity < 1 ? 1.5 : 3, vertexColors: true, transparent: true, opacity, depthWrite: false, dashed: isDashed });
      const line = new LineSegments2(new LineSegmentsGeometry(), material);
      line.frustumCulled = false;
      line.visible = false;
      parent.add(line);
      return line;
    });
  }

  /** Draws a track. `by` is what colours mean: "state", "confidence", or anything else, whose colour is `own`. Dashes are `dash_m` long. */
  set(track, by, own, dash_m) {
    const { positions, rows } = segmentsOf(track);
    this.endRows = rows.filter((_, end) => end % 2 === 1);
    const color = new Color();
    const colors = new Float32Array(positions.length);
    const states = theme().states.map((state) => new Color(state).toArray());
    const target = new Color(own).toArray();
    rows.forEach((row, point) => {
      let rgb = target;
      if (by === "state") rgb = states[track.state[row]];
      if (by === "confidence") rgb = color.setRGB(...confidenceColor(track.confidence[row]), SRGBColorSpace).toArray();
      colors.set(rgb, 3 * point);
    });
    for (const line of this.lines) {
      line.geometry.dispose();
      line.geometry = new LineSegmentsGeometry();
      line.visible = rows.length > 0;
      if (rows.length > 0) line.geometry.setPositions(positions).setColors(colors);
      if (rows.length > 0 && this.isDashed) {
        line.computeLineDistances();
        line.material.dashSize = dash_m;
        line.material.gapSize = dash_m;
      }
    }
  }

  /** Sets the row up to which the trail is bright; −1 for none of it. */
  showTo(row) {
    const count = lastAtOrBefore(this.endRows, this.endRows.length, row) + 1;
    this.lines[1].geometry.instanceCount = count;
    this.lines[1].visible = count > 0;
  }

  dispose() {
    for (const line of this.lines) {
      this.parent.remove(line);
      line.geometry.dispose();
      line.material.dispose();
    }
  }
}

/** Returns the ends of all segments and their rows. No segment crosses a row without a position. */
export function segmentsOf(track) {
  const step = Math.max(1, Math.ceil(track.length / MAX_POINTS));
  const [values, rows] = [[], []];
  let last = -1;
  for (let row = 0; row < track.length; row++) {
    const place = track.position(row);
    if (!place) {
      last = -1;
    } else if (last < 0) {
      last = row;
    } else if (row - last >= step || row + 1 === track.length || !track.position(row + 1)) {
      values.push(...track.position(last), ...place);
      rows.push(last, row);
      last = row;
    }
  }
  return { positions: Float32Array.from(values), rows };
}
