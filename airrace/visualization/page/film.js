// Saves what is seen as a film, made by the browser itself.
import { minutes, seconds } from "airrace/standing.js";

const RATE = 30; // pictures a second
const TYPES = ["video/mp4;codecs=avc1.42E01F", "video/webm;codecs=vp9", "video/webm"];

export class Film {
  constructor(stage, player) {
    this.stage = stage;
    this.player = player;
    this.button = document.getElementById("film");
    this.recorder = null;
    const can = typeof MediaRecorder !== "undefined";
    this.type = can && TYPES.find((type) => MediaRecorder.isTypeSupported(type));
    this.button.hidden = !this.type;
    this.button.onclick = () => (this.recorder ? this.stop() : this.start());
    // A film ends with what is played.
    player.addEventListener("change", () => {
      if (this.recorder && !player.playing) this.stop();
    });
  }

  start() {
    this.canvas = document.createElement("canvas");
    this.context = this.canvas.getContext("2d");
    // Encoders want even sizes.
    this.canvas.width = this.stage.canvas.width & ~1;
    this.canvas.height = this.stage.canvas.height & ~1;
    const stream = this.canvas.captureStream(RATE);
    const chunks = [];
    this.recorder = new MediaRecorder(stream, { mimeType: this.type,
      videoBitsPerSecond: 8e6 });
    this.recorder.ondataavailable = (event) => chunks.push(event.data);
    this.recorder.onstop = () => this.save(new Blob(chunks, { type: this.type }));
    this.recorder.start(500);
    if (!this.player.playing) this.player.play();
    this.show();
  }

  stop() {
    const { recorder } = this;
    this.recorder = null;
    recorder.stop();
    this.show();
  }

  show() {
    this.button.textContent = this.recorder ? "Save film" : "Film";
    this.button.classList.toggle("on", this.recorder !== null);
  }

  // Copies the picture that was just drawn, with the clock on it.
  take(standing) {
    if (!this.recorder) return;
    const { context, canvas } = this, size = Math.round(canvas.height / 22);
    context.drawImage(this.stage.canvas, 0, 0, canvas.width, canvas.height);
    const { lapTime, lap, laps, t } = standing;
    const text = lapTime !== null ? `lap ${lap}   ${seconds(lapTime)}`
      : laps.length ? `lap ${lap}   ${seconds(laps.at(-1).time)}` : minutes(t);
    context.font = `700 ${size}px system-ui, sans-serif`;
    context.fillStyle = "rgba(10, 16, 24, 0.65)";
    context.fillRect(size / 2, size / 2, context.measureText(text).width + size, 1.6 * size);
    context.fillStyle = "#fff";
    context.textBaseline = "middle";
    context.fillText(text, size, 1.35 * size);
  }

  save(blob) {
    this.saved = blob;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = this.type.startsWith("video/mp4") ? "race.mp4" : "race.webm";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  }
}
