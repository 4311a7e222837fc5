// The time that is shown: it runs, jumps, or follows the end of a race that goes on.

export class Player extends EventTarget {
  // live: whether the timeline grows.
  constructor(timeline, live) {
    super();
    this.timeline = timeline;
    this.live = live;
    this.following = live; // whether it keeps to the newest
    this.playing = live;
    this.rate = 1; // of a replay, or of going back in a live race
    this.time = timeline.start;
    this.pace = 1; // of the race itself, simulated seconds a second
    this.arrival = null; // simulated and wall time of the newest frame
  }

  // Notes that new frames have arrived, at a wall time (s).
  arrived(wall) {
    const end = this.timeline.end;
    if (this.arrival && end > this.arrival.end && wall > this.arrival.wall) {
      const pace = (end - this.arrival.end) / (wall - this.arrival.wall);
      this.pace += 0.15 * (Math.min(pace, 50) - this.pace);
    } else if (!this.arrival) this.time = end;
    if (!this.arrival || end > this.arrival.end) this.arrival = { end, wall };
  }

  // Lets a stretch of wall time pass (s).
  advance(dt) {
    const end = this.timeline.end;
    if (!this.playing) return;
    if (this.following) {
      // As fast as the race goes, and a little behind it, so that nothing jerks.
      const goal = end - 0.08 * this.pace;
      const behind = goal - this.time;
      if (Math.abs(behind) > 2 * Math.max(1, this.pace)) this.time = goal;
      else this.time += dt * Math.max(0, this.pace + 2 * behind);
      this.time = Math.min(Math.max(this.time, this.timeline.start), end);
      return;
    }
    this.time = Math.min(this.time + dt * this.rate, end);
    if (this.time >= end) {
      if (this.live && !this.timeline.over) this.follow();
      else this.pause();
    }
  }

  play() {
    if (!this.live && this.time >= this.timeline.end - 0.05) this.time = this.timeline.start;
    this.playing = true;
    this.changed();
  }

  pause() {
    this.playing = false;
    this.changed();
  }

  toggle() {
    this.playing ? this.pause() : this.play();
  }

  jump(time) {
    this.following = false;
    this.time = Math.min(Math.max(time, this.timeline.start), this.timeline.end);
    this.changed();
  }

  step(dt) {
    this.jump(this.time + dt);
  }

  follow() {
    this.following = this.live;
    this.playing = true;
    this.changed();
  }

  setRate(rate) {
    this.rate = rate;
    this.changed();
  }

  changed() {
    this.dispatchEvent(new Event("change"));
  }
}
