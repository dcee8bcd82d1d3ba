// The images of the present time, of one camera.
import { element, setPressed } from "pardalis/dom.js";
import { instant } from "pardalis/format.js";
import { lastAtOrBefore } from "pardalis/tracks.js";

/** Images come from a page or its server: nothing else is loaded. */
const ALLOWED = /^(data:image\/(jpeg|png);base64,|blob:|(?![a-z][a-z0-9+.-]*:|\/\/))/i;

export class Pictures {
  constructor(host) {
    this.host = host;
    this.tabs = element("div", { class: "pv-tabs", role: "group", "aria-label": "Camera" });
    this.image = element("img", { class: "pv-image", alt: "" });
    this.caption = element("p", { class: "pv-caption" });
    host.append(this.tabs, this.image, this.caption);
    this.setFrames([]);
  }

  /** Takes the frames of a scene: see viewer.js. */
  setFrames(frames) {
    this.frames = [...frames].sort((a, b) => a.time_s - b.time_s);
    const cameras = [...new Set(this.frames.flatMap((frame) => Object.keys(frame.images)))];
    this.ofCamera = new Map(cameras.map((camera) => {
      const own = this.frames.filter((frame) => camera in frame.images);
      return [camera, { times: own.map((frame) => frame.time_s), urls: own.map((frame) => frame.images[camera]) }];
    }));
    this.camera = cameras[0];
    this.tabs.replaceChildren(...cameras.map((camera) => element("button", { type: "button", onclick: () => this.#choose(camera) }, camera)));
    this.tabs.hidden = cameras.length < 2;
    this.host.hidden = cameras.length === 0;
    this.#choose(this.camera);
  }

  #choose(camera) {
    this.camera = camera;
    for (const tab of this.tabs.children) setPressed(tab, tab.textContent === camera);
    this.setTime(this.time_s);
  }

  setTime(time_s) {
    this.time_s = time_s;
    const own = this.ofCamera.get(this.camera);
    if (!own || time_s === undefined) return;
    const at = Math.max(0, lastAtOrBefore(own.times, own.times.length, time_s + 1e-9));
    const url = own.urls[at];
    if (!ALLOWED.test(url) || this.shown === url) return;
    this.shown = url;
    this.image.src = url;
    this.image.alt = `Image of ${this.camera} at ${instant(own.times[at])}`;
    this.caption.textContent = `${this.camera}, ${instant(own.times[at])}`;
  }
}
