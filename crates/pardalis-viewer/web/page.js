// A page with everything in it: reads the data that the page contains.
import { element } from "pardalis/dom.js";
import { showSummary } from "pardalis/summary.js";
import { Viewer } from "pardalis/viewer.js";

const data = JSON.parse(document.getElementById("data").textContent);
document.getElementById("title").textContent = data.scene.title;
const sets = data.summary?.frame_sets;
const names = data.scene.targets.map((target) => target.name).join(", ");
document.getElementById("subtitle").textContent = [names, sets && `${sets} frame sets`, data.scene.cameras.map((camera) => camera.name).join(", ")].filter(Boolean).join(" · ");
document.getElementById("program").append(element("span", {}, data.summary?.version ? `pardalis ${data.summary.version}` : "pardalis"));
const viewer = new Viewer(document.getElementById("viewer"));
viewer.setScene(data.scene);
viewer.setTracks(data.tracks);
viewer.showLastSeen();
if (data.comparison) {
  document.getElementById("title").textContent = data.comparison.names.join(" and ");
  viewer.setComparison(data.comparison);
}
showSummary(document.getElementById("summary"), data.summary, data.notes);
