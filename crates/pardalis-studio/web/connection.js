// Requests to the program, and what it shows.

/** Asks the program. Resolves to its answer; rejects with an Error whose message says what is wrong and how to correct it. */
export async function ask(request, value = {}) {
  let response;
  try {
    response = await fetch(`/api/${request}`, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(value),
    });
  } catch {
    throw new Error("The program does not answer; see whether it still runs.");
  }
  const answer = await response.json();
  if (!response.ok) throw new Error(answer.error);
  return answer;
}

/**
 * The latest message of each topic. `show(topic, value, image)` is called for each; `image` is an ImageBitmap or null. `connected(is)` is told
 * whether the program answers. The next messages are asked for when these have been shown, so that a slow page gets fewer.
 */
export class Live {
  constructor(show, connected) {
    this.show = show;
    this.connected = connected;
    this.pause_ms = 250;
    this.#open();
  }

  #open() {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    let shown = Promise.resolve();
    socket.onopen = () => {
      this.pause_ms = 250;
      this.connected(true);
      socket.send("more");
    };
    socket.onmessage = ({ data }) => {
      // Images are decoded side by side, and shown in turn.
      const message = data === "end" ? null : read(data);
      message?.catch(() => {});
      shown = shown.then(async () => (message ? this.show(...(await message)) : socket.send("more"))).catch(console.error);
    };
    socket.onclose = () => {
      this.connected(false);
      setTimeout(() => this.#open(), this.pause_ms);
      this.pause_ms = Math.min(2 * this.pause_ms, 5000);
    };
  }
}

/** Returns topic, value and image of a message. */
async function read(data) {
  if (typeof data === "string") {
    const { topic, value } = JSON.parse(data);
    return [topic, value, null];
  }
  const length = new DataView(data).getUint32(0);
  const { topic, sequence, value } = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const image = await createImageBitmap(new Blob([new Uint8Array(data, 4 + length)], { type: "image/jpeg" }));
  return [topic, { ...value, sequence }, image];
}
