// The page: its state, its steps and its pictures.

import { ask, Live } from "./connection.js";
import { button, el, onRelease, replaceChildren } from "./elements.js";
import { Picture } from "./picture.js";
import { camera } from "./steps/camera.js";
import { colors } from "./steps/colors.js";
import { pose } from "./steps/pose.js";
import { sources } from "./steps/sources.js";
import { targets } from "./steps/targets.js";
import { track } from "./steps/track.js";

const STEPS = [sources, camera, pose, colors, targets, track];
/** A camera without an image for this many seconds is reported as silent. */
const SILENT_S = 1.5;
const byId = (id) => document.getElementById(id);

/** What all steps share. */
const app = {
  /** The state of the session, as the program tells it. */
  state: null,
  /** The camera and the target that are worked on, by name. */
  camera: null,
  target: null,
  /** The latest message of each topic, and the latest image of each camera. */
  latest: new Map(),
  images: new Map(),
  step: sources,
  /** The pictures that are shown, by camera. */
  pictures: new Map(),

  /** Asks the program for an edit once those before are answered, or says why it is refused. Resolves to the answer, or null. */
  change(request, value = {}) {
    lastEdit = lastEdit.then(() => edit(request, value));
    return lastEdit;
  },

  /** Goes to a frame of a camera's recording, plays it or holds it. Of orders that come before the one before is answered, the last counts. */
  async order(camera, order) {
    if (orders.has(camera)) {
      orders.set(camera, { ...orders.get(camera), ...order });
      return;
    }
    try {
      for (let next = order; next !== null; next = orders.get(camera)) {
        orders.set(camera, null);
        await ask("show", { camera, ...next });
      }
    } catch (error) {
      say(error.message, true);
    } finally {
      orders.delete(camera);
    }
  },

  /** Takes a state of the session, unless a later one was faster. */
  take(state) {
    if (state.number < this.state?.number) return;
    // A page of `track --watch` only shows the run.
    if (state.watched) {
      state = watchedState(state.watched);
      document.body.classList.add("watched");
      this.step = track;
    }
    this.state = state;
    const names = (list) => list.map(({ name }) => name);
    if (!names(state.cameras).includes(this.camera)) this.camera = names(state.cameras)[0] ?? null;
    if (!names(state.targets).includes(this.target)) this.target = names(state.targets)[0] ?? null;
    this.render();
  },

  go(step) {
    if (this.step !== step) this.step.leave?.(this);
    this.step = step;
    location.hash = step.id;
    step.enter?.(this);
    this.render();
  },

  select(what, name) {
    this[what] = name;
    this.step.enter?.(this);
    this.render();
  },

  say,

  /** Shows the images of the pictures again, where a step has chosen others. */
  showImages() {
    for (const [name, picture] of this.pictures) showLatest(name, picture);
  },

  render() {
    if (!this.state) return;
    renderHeader();
    renderSteps();
    renderPictures();
    renderPanel();
  },
};

/** The next order to each camera that one is under way to, or null. */
const orders = new Map();

/** What was said of the last edit, if it failed. */
let failure = null;

/** The answer to the last edit that was asked for. */
let lastEdit = Promise.resolve();

async function edit(request, value) {
  document.body.classList.add("busy");
  // It would look like the answer to this one.
  failure?.remove();
  try {
    const answer = await ask(request, value);
    if (answer.cameras) app.take(answer);
    return answer;
  } catch (error) {
    failure = say(error.message, true);
    return null;
  } finally {
    document.body.classList.remove("busy");
  }
}

/** Returns the state of a page that shows a run, from what the program has shown of it. */
function watchedState(path) {
  const scene = app.latest.get("scene");
  const names = (list) => (list ?? []).map(({ name }) => ({ name }));
  const run = { goes_on: !app.latest.has("over") };
  return { watched: path, path, is_saved: true, undo: null, redo: null, problems: [], guesses: [], cameras: names(scene?.cameras), targets: names(scene?.targets), run };
}

/** Shows a message for a while; errors until they are closed. Returns its element. */
function say(text, isError = false) {
  const message = el("div", { class: isError ? "message error" : "message" }, el("p", {}, text));
  message.append(button("×", () => message.remove(), { "aria-label": "Close" }));
  byId("messages").append(message);
  while (byId("messages").childElementCount > 3) byId("messages").firstElementChild.remove();
  if (!isError) setTimeout(() => message.remove(), 4000);
  return message;
}

function renderHeader() {
  const { path, is_saved: isSaved, undo, redo } = app.state;
  byId("file").textContent = isSaved ? path : `${path} – not saved`;
  document.title = `${isSaved ? "" : "• "}${path} – Pardalis studio`;
  for (const [id, what, name] of [["undo", undo, "Undo"], ["redo", redo, "Redo"]]) {
    byId(id).disabled = what === null;
    byId(id).title = what === null ? `Nothing to ${id}` : `${name}: ${what} (${id === "undo" ? "Ctrl+Z" : "Ctrl+Shift+Z"})`;
  }
  byId("save").disabled = isSaved;
}

/** Returns what is wrong in a step. */
function problemsOf(step) {
  return app.state.problems.filter((problem) => problem.step === step.id);
}

/** Whether a problem is shown: what is missing is none before its step has begun. */
function isShown(step, problem) {
  return step.isBegun(app) || problem.is_warning || problem.is_unread;
}

/** Returns "done", "todo" or "wrong". */
function statusOf(step) {
  const wrong = problemsOf(step).filter((problem) => !problem.is_warning);
  if (step.isDone(app)) return wrong.length > 0 || step.isDoubtful?.(app) ? "wrong" : "done";
  return wrong.some((problem) => isShown(step, problem)) ? "wrong" : "todo";
}

function renderSteps() {
  const marks = { done: "✓", wrong: "!", todo: "" };
  const names = { done: "done", wrong: "has problems", todo: "to do" };
  const steps = STEPS.map((step, index) => {
    const status = statusOf(step);
    const number = el("span", { class: `number ${status}` }, marks[status] || String(index + 1));
    return button([number, step.title], () => app.go(step), {
      id: `step-${step.id}`,
      class: "step",
      title: `${step.title}: ${names[status]} (Alt+${index + 1})`,
      "aria-current": app.step === step && "step",
    });
  });
  replaceChildren(byId("steps"), steps);
}

function renderPictures() {
  const { cameras } = app.state;
  const shown = app.step.showsAll ? cameras : cameras.filter(({ name }) => name === app.camera);
  const key = JSON.stringify([app.step.id, [cameras, shown].map((list) => list.map(({ name }) => name)), app.step.pictureKey?.(app), Boolean(app.state.run)]);
  const section = byId("pictures");
  if (section.dataset.key !== key) {
    section.dataset.key = key;
    for (const picture of app.pictures.values()) picture.dispose();
    app.pictures.clear();
    section.replaceChildren();
    section.classList.toggle("many", shown.length > 1);
    if (cameras.length === 0) section.append(el("p", { class: "empty" }, "Add a camera or a recording to see its picture here."));
    const above = app.step.above?.(app);
    if (above) section.append(above);
    if (!app.step.showsAll && cameras.length > 1) {
      const tabs = cameras.map(({ name }) => button(name, () => app.select("camera", name), { "aria-pressed": String(name === app.camera), id: `tab-${name}` }));
      section.append(el("div", { class: "tabs" }, tabs));
    }
    const grid = el("div", { class: "grid" });
    for (const { name } of app.step.hidesPictures?.() ? [] : shown) {
      const picture = new Picture(name, app.step.picture?.(app, name) ?? {});
      app.pictures.set(name, picture);
      grid.append(picture.element);
    }
    if (grid.childElementCount > 0) section.append(grid);
    const below = app.step.below?.(app);
    if (below) section.append(below);
    for (const [name, picture] of app.pictures) showLatest(name, picture);
  }
  for (const [name, picture] of app.pictures) {
    replaceChildren(picture.caption, captionOf(name));
    picture.redraw();
  }
}

function showLatest(name, picture) {
  const latest = app.step.imageOf?.(app, name) ?? app.images.get(name);
  if (latest) picture.show(latest.image, latest.about);
}

/** Says that no image comes from a camera, if that is so for some seconds. */
function silence(seconds) {
  return seconds > SILENT_S ? el("span", { class: "bad" }, `no image for ${Math.round(seconds)} s; waiting for the camera`) : "";
}

/** When the run began, as far as this page knows, in its milliseconds. */
let begun_ms = performance.now();

/** Returns for how many seconds no image of a topic of the run has come. */
function secondsWithoutImage(topic) {
  return (performance.now() - (app.images.get(topic)?.at ?? begun_ms)) / 1000;
}

/** Returns the name of a camera with how its frames come, and buttons to move in a recording. */
function captionOf(name) {
  const camera = app.state.cameras.find((one) => one.name === name);
  const source = app.latest.get(`source/${name}`) ?? {};
  const parts = [el("strong", {}, name)];
  const error = source.error ?? camera?.source?.error;
  if (error) return [...parts, el("span", { class: "bad" }, error)];
  if (app.state.run?.goes_on) return [...parts, silence(camera?.source ? 0 : secondsWithoutImage(`run/${name}`))];
  if (!camera?.source || app.step.imageOf?.(app, name)?.isOfRun) return parts;
  const rate = source.rate_hz ? `${source.rate_hz.toFixed(1)} per second` : "";
  if (camera.source.is_live) {
    if (source.silent_s) return [...parts, silence(source.silent_s)];
    const lost = `${source.lost ?? 0} of ${(source.frames ?? 0) + (source.lost ?? 0)} lost`;
    const delay = `${Math.round(source.delay_ms ?? 0)} ms late`;
    const toggle = button(source.is_playing === false ? "▶ Go on" : "❚❚ Hold", () => app.order(name, { is_playing: source.is_playing === false }), {
      id: `play-${name}`,
    });
    return [...parts, el("span", { class: "live" }, "live"), el("span", {}, [rate, delay, lost].filter(Boolean).join(" · ")), toggle];
  }
  const count = camera.source.frame_count;
  const frame = source.frame ?? 0;
  const goTo = (number) => app.order(name, { frame: Math.min(Math.max(number, 0), (count ?? Infinity) - 1), is_playing: false });
  const slider =
    count > 1 &&
    el("input", {
      type: "range", id: `frame-${name}`, min: 0, max: count - 1, value: frame, "aria-label": `Frame of ${name}`,
      oninput: (event) => goTo(Number(event.target.value)),
    });
  const play = button(source.is_playing ? "❚❚" : "▶", () => app.order(name, { is_playing: !source.is_playing }), {
    id: `play-${name}`, "aria-label": source.is_playing ? "Pause" : "Play",
  });
  const number = el("span", { class: "number-of-frame" }, count ? `${frame} / ${count - 1}` : `${frame}`);
  return count === 1 ? parts : [...parts, play, slider, number];
}

function renderPanel() {
  const { step } = app;
  const problems = problemsOf(step).filter((problem) => isShown(step, problem));
  const list = problems.map(({ key, message, line, is_warning: isWarning }) =>
    el("li", { class: isWarning ? "warning" : "problem" }, el("code", {}, line ? `${key}, line ${line}` : key), el("span", {}, message)),
  );
  const next = STEPS[STEPS.indexOf(step) + 1];
  const isDone = statusOf(step) === "done";
  replaceChildren(
    byId("panel"),
    el("h2", {}, step.title),
    el("p", { class: "hint" }, step.hint(app)),
    el("div", { class: "controls" }, step.render(app)),
    list.length > 0 && el("ul", { class: "problems" }, list),
    next && el("div", { class: "next" }, button(`Next: ${next.title}`, () => app.go(next), { id: "next", class: isDone ? "primary" : "" })),
  );
}

/** Says that the program does not answer, or that the run is over. */
let announced = null;

/** Forgets what an earlier run showed. */
function forgetRun() {
  app.latest.delete("track");
  for (const key of [...app.images.keys()].filter((key) => key.startsWith("run/"))) {
    // Pictures that show it keep it.
    app.images.delete(key);
    app.pictures.get(key.slice("run/".length))?.wait();
  }
  begun_ms = performance.now();
}

function show(topic, value, image) {
  if (topic === "state") return app.take(value);
  const [kind, name] = topic.split(/\/(.*)/);
  if (image) {
    // Images of cameras have the names of these.
    const key = kind === "image" ? name : topic;
    const before = app.images.get(key);
    app.images.set(key, { image, about: value, at: performance.now() });
    before?.image.close();
    // The latest images and messages may come before the state.
    if (!app.state) return;
    app.step.seen?.(app, topic);
    // Drawing takes most of the time of a page: only the picture that the image is of, unless it may be any.
    const own = app.pictures.get(name);
    for (const [camera, picture] of own ? [[name, own]] : app.pictures) showLatest(camera, picture);
    if (topic === "marked") renderPanel();
    return;
  }
  app.latest.set(topic, value);
  // Another run begins.
  if (topic === "scene") forgetRun();
  if (app.state?.watched && (topic === "scene" || topic === "over")) app.take(app.state);
  if (topic === "changed") return ask("state").then((state) => app.take(state));
  if (kind === "source" && app.pictures.has(name)) app.pictures.get(name).caption.isConnected && updateCaption(name);
  if (app.state) app.step.told?.(app, topic, value);
}

/** A slider that is held keeps its element. */
function updateCaption(name) {
  const { caption } = app.pictures.get(name);
  if (caption.contains(document.activeElement) && document.activeElement.type === "range") {
    const source = app.latest.get(`source/${name}`);
    caption.querySelector(".number-of-frame").textContent = `${source.frame} / ${source.frame_count - 1}`;
    return;
  }
  replaceChildren(caption, captionOf(name));
}

onRelease(() => app.render());

// What does not come changes the captions, too.
setInterval(() => app.state?.run?.goes_on && [...app.pictures.keys()].forEach(updateCaption), 1000);

/** The text of the scene when the program stopped to answer, if it was not saved. */
let unsaved = null;

/** Says what a program that was started anew does not know, and offers to give it to that. */
function offerUnsaved() {
  if (unsaved === null || app.state.watched || app.state.text === unsaved) return;
  const text = unsaved;
  unsaved = null;
  const message = say("The program was started anew without having saved the scene of this page.", true);
  const restore = () => app.change("restore", { text }).then((answer) => answer && message.remove());
  message.lastChild.before(button("Put the scene back", restore, { id: "restore", class: "restore" }));
}

function connected(is) {
  document.body.classList.toggle("offline", !is);
  if (is) {
    // A program that was started anew numbers its states anew.
    if (app.state) app.state.number = 0;
    ask("state").then((state) => {
      app.take(state);
      if (announced) say("The program answers again.");
      announced?.remove();
      announced = null;
      offerUnsaved();
    }, (error) => say(error.message, true));
  } else if (app.latest.has("over")) {
    announced ??= say("The run is over.");
  } else if (!announced) {
    if (app.state && !app.state.is_saved && app.state.undo !== null) unsaved = app.state.text;
    announced = say("The program does not answer; see whether it still runs.", true);
  }
}

const undo = () => app.change("undo");
const redo = () => app.change("redo");
const save = async () => (await app.change("save")) && say("Saved.");

document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase();
  const isText = event.target.matches?.("input[type=text], input[type=number], textarea");
  if ((event.ctrlKey || event.metaKey) && key === "s") save();
  else if ((event.ctrlKey || event.metaKey) && !isText && (key === "y" || (key === "z" && event.shiftKey))) redo();
  else if ((event.ctrlKey || event.metaKey) && !isText && key === "z") undo();
  else if (event.altKey && STEPS[Number(event.key) - 1]) app.go(STEPS[Number(event.key) - 1]);
  else return;
  event.preventDefault();
});
byId("undo").addEventListener("click", undo);
byId("redo").addEventListener("click", redo);
byId("save").addEventListener("click", save);
window.addEventListener("beforeunload", (event) => {
  if (app.state && !app.state.is_saved && app.state.undo !== null) event.preventDefault();
});
window.addEventListener("hashchange", () => {
  const step = STEPS.find(({ id }) => id === location.hash.slice(1));
  if (step && step !== app.step) app.go(step);
});

app.step = STEPS.find(({ id }) => id === location.hash.slice(1)) ?? sources;
new Live(show, connected);
