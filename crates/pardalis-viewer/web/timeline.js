// The present time: slider, playing, keys.
import { element, setPressed } from "pardalis/dom.js";
import { instant } from "pardalis/format.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 10];

export class Timeline {
  /** `change(index)` is called when the user or playing chooses another of the times. */
  constructor(host, change) {
    this.change = change;
    this.times = [];
    this.frames = [];
    this.index = 0;
    this.play = element("button", { type: "button", class: "pv-play", "aria-label": "Play", title: "Play or pause (space)", onclick: () => this.toggle() }, "▶");
    this.slider = element("input", { type: "range", min: 0, max: 0, value: 0, step: 1, class: "pv-slider", "aria-label": "Time", oninput: () => this.#choose(Number(this.slider.value)) });
    this.speed = element("select", { "aria-label": "Speed", title: "Speed" },
      ...SPEEDS.map((speed) => element("option", { value: speed, selected: speed === 1 }, `${speed}×`)));
    this.label = element("output", { class: "pv-time" });
    this.follow = element("button", { type: "button", class: "pv-follow", hidden: "", onclick: () => this.#choose(this.times.length - 1) }, "newest");
    host.append(this.play, this.speed, this.slider, this.label, this.follow);
    this.isLive = false;
    this.#show();
  }

  /** Takes the times in ascending order, and the number of the frame of each. */
  setTimes(times, frames) {
    this.times = times;
    this.frames = frames;
    this.slider.max = Math.max(0, times.length - 1);
    this.slider.disabled = this.play.disabled = times.length < 2;
    this.#show();
  }

  /** Rows come while they are looked at. */
  setLive() {
    this.isLive = true;
    this.follow.hidden = false;
  }

  setIndex(index) {
    this.index = Math.min(Math.max(0, index), Math.max(0, this.times.length - 1));
    this.#show();
  }

  /** Whether the newest time is shown. */
  isAtEnd() {
    return this.index >= this.times.length - 1;
  }

  step(count) {
    this.#choose(this.index + count);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.#start();
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = undefined;
    this.play.textContent = "▶";
    this.play.setAttribute("aria-label", "Play");
  }

  #start() {
    if (this.times.length < 2) return;
    if (this.isAtEnd()) this.#choose(0);
    this.play.textContent = "❚❚";
    this.play.setAttribute("aria-label", "Pause");
    let [now_s, shownAt] = [this.times[this.index], performance.now()];
    const tick = (at) => {
      now_s += (Number(this.speed.value) * Math.max(0, at - shownAt)) / 1000;
      shownAt = at;
      let index = this.index;
      while (index + 1 < this.times.length && this.times[index + 1] <= now_s) index++;
      if (index !== this.index) this.#move(index);
      if (this.isAtEnd()) this.pause();
      else this.playing = requestAnimationFrame(tick);
    };
    this.playing = requestAnimationFrame(tick);
  }

  #choose(index) {
    this.pause();
    this.#move(index);
  }

  #move(index) {
    this.setIndex(index);
    this.change(this.index);
  }

  #show() {
    const time_s = this.times[this.index];
    const frame = this.frames[this.index];
    this.slider.value = this.index;
    this.label.textContent = time_s === undefined ? "no rows" : instant(time_s);
    const ofFrame = Number.isFinite(frame) ? `, frame ${frame}` : "";
    this.slider.setAttribute("aria-valuetext", this.label.textContent + ofFrame);
    setPressed(this.follow, this.isLive && this.isAtEnd());
  }

  /** Handles a key; returns whether it means something. */
  key(event) {
    const far = event.shiftKey ? 10 : 1;
    const actions = {
      " ": () => this.toggle(),
      ArrowLeft: () => this.step(-far),
      ArrowRight: () => this.step(far),
      Home: () => this.#choose(0),
      End: () => this.#choose(this.times.length - 1),
    };
    actions[event.key]?.();
    return event.key in actions;
  }

  dispose() {
    this.pause();
  }
}
