/**
 * Shows tracks: a 3D view, plots over time, states, numbers and images.
 *
 *     const viewer = new Viewer(element);
 *     viewer.setScene(scene);       // any number of times, in any order with the tracks
 *     viewer.setTracks(tracks);     // replaces all rows
 *     viewer.append(rows, poses);   // adds rows of a live run and, if cameras move, where these were
 *     viewer.setComparison(comparison); // another run over the tracks that are shown; null: none
 *     viewer.setTime(time_s);       // shows the last rows that are not after this time
 *     viewer.dispose();             // removes everything from the element, and all listeners
 *
 * After `append` the newest time is shown, unless the user (or `setTime`) has gone back.
 *
 * Frames: the world frame has z up. The camera frame has x to the right, y down and z forward along the optical axis. Lengths are in metres, times in seconds,
 * angles in radians; in scenes whose plane is the image (`units: "px"`), lengths are in pixels. Names and titles may be any text; they are never read as HTML.
 *
 * `scene`:
 *
 *     {
 *       title: "ball",
 *       units: "m",                                    // or "px"
 *       cameras: [{
 *         name: "left",
 *         position_m: [x, y, z],                       // in the world; null if it is unknown
 *         world_from_camera: [[3 numbers], [3], [3]],  // rotation, row by row; null if it is unknown
 *         image_size: [width, height],                 // pixels
 *         border_rays: [[x, y, z], ...],               // unit directions in the camera frame around the image or its valid part
 *         footprint_m: [[x, y, z], ...],               // optional: the border of the image on the plane, for a camera that is described by its plane
 *         path: [[time_s, x, y, z, qw, qx, qy, qz], ...], // optional: poses (world from camera) of a camera that moves, in order of time
 *       }],
 *       guesses: ["the pose of left"],               // optional: what is not measured
 *       targets: [{ name: "ball", shape: SHAPE }],     // "ball" is also the shape of the members "ball-1", "ball-2", ... of a crowd
 *       frames: [{ time_s, images: { left: URL } }],   // optional: images with or without outlines, as data: or relative URLs
 *     }
 *
 * SHAPE is one of
 *
 *     { kind: "sphere", radius_m }
 *     { kind: "cylinder", radius_m, height_m }
 *     { kind: "prism", sides, across_flats_m, rotation_rad, height_m }   // rotation: of a corner from the heading
 *     { kind: "box", size_m: [along, across, height] }
 *     { kind: "disc", radius_m, height_m }                               // height above the position
 *     { kind: "rectangle", size_m: [along, across], height_m }           // likewise
 *
 * whose origin is the position in tracks.csv: the centre of a ball, the centre of the base of a cylinder, prism or box, the ground below a disc or rectangle.
 *
 * `tracks` and `rows` map names of targets to columns of the same length, named as in tracks.csv: `time_s`, `frame`, `state` ("searching", "tracking", "occluded",
 * "lost"), `x_m` ... `z_m`, `vx_mps` ... `vz_mps`, `heading_rad`, `xx_m2` ... `zz_m2`, `confidence`, `radius_m`, `sigma_radius_m`, `sigma_heading_rad`,
 * `vxx_m2ps2` ... `vzz_m2ps2`. Entries are numbers or null; all columns but `time_s` may be missing.
 *
 * `poses` map names of cameras to poses, each as in `path`, later than those before.
 *
 * `comparison`, of two finished runs of the same recording:
 *
 *     {
 *       names: ["ball-tracks", "run7"],                // of the run in `tracks`, and of the other
 *       tracks: { ... },                               // those of the other
 *       targets: {
 *         ball: {
 *           figures: [FIGURES, FIGURES],               // of each run; null if it lacks the target
 *           distance: { times, median_m, largest_m, largest_at_s }, // between both, at times at which both have a position; or null
 *         },
 *       },
 *       other_is_earlier: false,                       // whether changes are those from the other to the run in `tracks`
 *       settings: [{ key, values: ["1", "2"] }],       // settings that differ, with their values as texts; null: not set
 *     }
 *
 * with FIGURES `{ rows: { tracking: 12, ... }, mean_confidence, median_sigma_m }`: rows in each state that occurs, and the median of the standard deviation of the
 * position, the square root of the trace of its covariance.
 */
import { CONFIDENCE_GRADIENT, onThemeChange, theme } from "pardalis/colors.js";
import { ComparisonTable, runSwatch } from "pardalis/comparison.js";
import { element, setPressed } from "pardalis/dom.js";
import { setOrigin } from "pardalis/format.js";
import { Pictures } from "pardalis/pictures.js";
import { Plots } from "pardalis/plots.js";
import { createStage, VIEWS } from "pardalis/stage.js";
import { Strip } from "pardalis/strip.js";
import { Timeline } from "pardalis/timeline.js";
import { MEANINGS, STATES, Tracks, joinedTimes, lastAtOrBefore, nearbyTracks } from "pardalis/tracks.js";
import { Values } from "pardalis/values.js";

/** What the colours of trails may mean; "run" if two are compared. */
const COLORINGS = ["state", "confidence", "target", "run"];

export class Viewer {
  constructor(host) {
    this.host = host;
    this.tracks = new Tracks();
    this.scene = { title: "", units: "m", cameras: [], targets: [] };
    this.#build();
    this.onKey = (event) => this.#key(event);
    document.addEventListener("keydown", this.onKey);
    this.stopThemes = onThemeChange(() => {
      this.#refreshTracks();
      this.#showIndex(this.timeline.index);
    });
    this.#refreshTracks();
  }

  setScene(scene) {
    this.scene = { title: "", units: "m", ...scene, cameras: scene.cameras ?? [], targets: scene.targets ?? [] };
    this.pictures.setFrames(this.scene.frames ?? []);
    const guesses = this.scene.guesses ?? [];
    this.guessHost.hidden = guesses.length === 0;
    this.guessHost.textContent = `Positions are only as right as these guesses: ${guesses.join(", ")}.`;
    this.stage?.setScene(this.scene);
    this.#plot();
    this.#refreshTracks();
  }

  setTracks(tracks) {
    this.tracks = new Tracks();
    this.tracks.append(tracks);
    this.selected = this.origin = undefined;
    this.#refreshTracks();
    // The end: the whole trail.
    this.#showIndex(this.times.length - 1);
  }

  /** Shows the latest time at which a target was seen, with the whole trail before it: recordings go on after targets have left. */
  showLastSeen() {
    const last = [...this.tracks.all.values()].map((track) => track.time_s[track.lastSeen()] ?? -Infinity);
    const last_s = Math.max(...last);
    if (Number.isFinite(last_s)) this.setTime(last_s);
  }

  append(rows, poses = {}) {
    for (const camera of this.scene.cameras) {
      if (poses[camera.name]?.length > 0) camera.path = [...(camera.path ?? []), ...poses[camera.name]];
    }
    const follows = this.times.length === 0 || this.timeline.isAtEnd();
    const shown_s = this.times[this.timeline.index];
    this.tracks.append(rows);
    this.timeline.setLive();
    this.#refreshTracks();
    this.#showIndex(follows ? this.times.length - 1 : this.#indexAt(shown_s));
  }

  setComparison(comparison) {
    const shown_s = this.time_s;
    const isAtEnd = this.timeline.isAtEnd();
    this.comparison = comparison;
    this.other = comparison ? nearbyTracks(comparison.tracks) : null;
    this.#plot();
    this.#refreshTracks();
    this.#showIndex(isAtEnd ? this.times.length - 1 : this.#indexAt(shown_s));
  }

  setTime(time_s) {
    this.timeline.pause();
    this.#showIndex(this.#indexAt(time_s));
  }

  dispose() {
    document.removeEventListener("keydown", this.onKey);
    this.stopThemes();
    cancelAnimationFrame(this.pendingStage);
    for (const part of [this.stage, this.plots, this.strip, this.timeline]) part?.dispose();
    this.host.replaceChildren();
  }

  #build() {
    const sceneHost = element("div", { class: "pv-scene" });
    const sideHost = element("div", { class: "pv-side" });
    const picturesHost = element("div", { class: "pv-pictures" });
    const valuesHost = element("div", { class: "pv-values" });
    const stripHost = element("div", { class: "pv-states" });
    const comparisonHost = element("section", { class: "pv-comparison", "aria-label": "Two runs" });
    const plotsHost = element("div", { class: "pv-plots" });
    const timelineHost = element("div", { class: "pv-timeline", role: "group", "aria-label": "Time" });
    sideHost.append(picturesHost, valuesHost);
    this.guessHost = element("p", { class: "pv-guesses", hidden: "" });
    this.root = element("div", { class: "pv" }, this.guessHost, element("div", { class: "pv-top" }, sceneHost, sideHost), comparisonHost, stripHost, plotsHost, timelineHost);
    this.host.replaceChildren(this.root);
    const pick = (time_s) => this.setTime(time_s);
    const select = (name) => this.#select(name);
    this.stage = createStage(sceneHost);
    if (this.stage) this.#buildControls(sceneHost);
    else sceneHost.append(element("p", { class: "pv-no-webgl" }, "This browser has no WebGL 2, which the 3D view needs. Numbers and plots work without it."));
    this.legendHost = element("div", { class: "pv-legend" });
    stripHost.append(element("div", { class: "pv-legends" }, this.legendHost, meanings()));
    this.pictures = new Pictures(picturesHost);
    this.values = new Values(valuesHost, select);
    this.strip = new Strip(stripHost, pick, select);
    this.comparisonTable = new ComparisonTable(comparisonHost, pick);
    this.plots = new Plots(plotsHost, pick);
    this.timeline = new Timeline(timelineHost, (index) => this.#showIndex(index));
  }

  #buildControls(host) {
    const buttons = Object.keys(VIEWS).map((view, number) => element("button", { type: "button", title: `View: ${view} (key ${number + 1})`, onclick: () => this.#setView(view) }, view));
    this.viewButtons = Object.fromEntries(Object.keys(VIEWS).map((view, number) => [view, buttons[number]]));
    this.coloringChoice = element("select", { "aria-label": "Colour of trails", onchange: () => this.#setColoring(this.coloringChoice.value) },
      ...COLORINGS.map((coloring) => element("option", { value: coloring }, `colour: ${coloring}`)));
    host.append(element("div", { class: "pv-views", role: "group", "aria-label": "View" }, ...buttons), element("div", { class: "pv-coloring" }, this.coloringChoice));
    setPressed(buttons[0], true);
  }

  #setView(view) {
    this.stage.setView(view);
    for (const [name, button] of Object.entries(this.viewButtons)) setPressed(button, name === view);
  }

  #setColoring(coloring) {
    this.chosenColoring = coloring;
    this.#refreshTracks();
    this.#showIndex(this.timeline.index);
  }

  #select(name) {
    this.selected = name;
    this.#plot();
    this.strip.setTracks(this.#runs(), name);
    this.comparisonTable.show(this.comparison, name, this.scene.units);
    this.#showIndex(this.timeline.index);
  }

  /** The tracks of the run, and of another one if two are compared. */
  #runs() {
    return this.other ? [this.tracks, this.other] : [this.tracks];
  }

  #plot() {
    this.plotted = this.#runs().map((tracks) => tracks.all.get(this.selected));
    this.plots.setTracks(this.plotted, this.scene.units);
  }

  /** Returns what the colours of trails mean. */
  #coloring() {
    const chosen = this.chosenColoring === "run" && !this.other ? null : this.chosenColoring;
    return chosen ?? (this.other ? "run" : this.tracks.all.size > 1 ? "target" : "state");
  }

  #indexAt(time_s) {
    return Math.max(0, lastAtOrBefore(this.times, this.times.length, time_s));
  }

  /** Shows rows that have come. */
  #refreshTracks() {
    const runs = this.#runs();
    Object.assign(this, runs.length > 1 ? joinedTimes(...runs) : { times: this.tracks.times, frames: this.tracks.frames });
    if (this.origin === undefined && this.times.length > 0) this.origin = setOrigin(this.times[0]);
    if (!runs.some((tracks) => tracks.all.has(this.selected))) this.selected = runs.flatMap((tracks) => [...tracks.all.keys()])[0];
    // Of two runs, the rows of one may come later.
    if (runs.some((tracks, run) => tracks.all.get(this.selected) !== this.plotted?.[run])) this.#plot();
    else this.plots.refresh();
    this.timeline.setTimes(this.times, this.frames);
    this.strip.setTracks(runs, this.selected);
    this.comparisonTable.show(this.comparison, this.selected, this.scene.units);
    this.#legend();
    // Rows may come faster than the screen shows them.
    if (this.stage) this.pendingStage ??= requestAnimationFrame(() => this.#refreshStage());
  }

  #refreshStage() {
    this.pendingStage = undefined;
    const runs = this.#runs();
    const names = [...new Set(runs.flatMap((tracks) => [...tracks.all.keys()]))];
    const by = this.#coloring();
    this.stage.setTracks(runs, {
      by,
      shapeOf: (name) => this.#shapeOf(name),
      colorOf: (name, run) => (by === "run" ? theme().runs[run] : theme().targets[names.indexOf(name) % theme().targets.length]),
    });
    this.stage.setPaths();
    this.stage.setTime(this.time_s, this.selected);
  }

  /** The shape of a target, or of the crowd that it is a member of. */
  #shapeOf(name) {
    const { targets } = this.scene;
    const own = targets.find((target) => target.name === name);
    const crowd = targets.find((target) => target.name === name.replace(/-\d+$/, ""));
    return (own ?? crowd)?.shape;
  }

  #showIndex(index) {
    this.timeline.setIndex(index);
    this.time_s = this.times[this.timeline.index];
    const frame = this.frames[this.timeline.index];
    this.values.show(this.#runs(), this.selected, this.time_s, frame, this.scene.units);
    this.pictures.setTime(this.time_s);
    this.plots.setTime(this.time_s);
    this.strip.setTime(this.time_s);
    if (!this.pendingStage) this.stage?.setTime(this.time_s, this.selected);
  }

  #legend() {
    if (this.coloringChoice) {
      this.coloringChoice.lastChild.hidden = !this.other;
      this.coloringChoice.value = this.#coloring();
    }
    const states = STATES.map((state, code) => element("span", {}, element("i", { class: "pv-dot", style: `background: ${theme().states[code]}` }), state));
    const ramp = element("span", {}, "confidence 0", element("i", { class: "pv-ramp", style: `background: ${CONFIDENCE_GRADIENT}` }), "1");
    const runs = this.comparison ? this.comparison.names.map((name, run) => element("span", {}, runSwatch(run), name)) : [];
    const origin = this.origin ? [element("span", { class: "pv-origin" }, `0 s is ${this.origin}`)] : [];
    this.legendHost.replaceChildren(element("h2", {}, "States"), ...states, ...(this.#coloring() === "confidence" ? [ramp] : []), ...runs, ...origin);
  }

  #key(event) {
    const { target } = event;
    const isOwn = target === document.body || this.root.contains(target) || target.closest("#summary");
    if (!isOwn || event.ctrlKey || event.altKey || event.metaKey || target.matches("textarea, select, input:not(.pv-slider)")) return;
    // What can be pressed is, by the space bar.
    if (event.key === " " && target.matches("button, summary")) return;
    const view = Object.keys(VIEWS)[Number(event.key) - 1];
    if (view && this.stage) this.#setView(view);
    if ((view && this.stage) || this.timeline.key(event)) event.preventDefault();
  }
}

/** What the states mean, for readers who want to know. */
function meanings() {
  const terms = STATES.flatMap((state) => [element("dt", {}, state), element("dd", {}, MEANINGS[state])]);
  return element("details", { class: "pv-meanings" }, element("summary", {}, "What states mean"), element("dl", {}, ...terms));
}
