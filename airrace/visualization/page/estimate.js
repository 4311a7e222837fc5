// Where the drone believes to be: a translucent twin, and the ellipsoid of three standard deviations
// of its position.

import { countUntil, last } from "airrace/timeline.js";

const COLOR = 0x19b5ff, OPACITY = 0.5;
const LOOK = 2; // s, between two looks whether the drone's shape has come

export class Estimate {
  constructor(stage, timeline, body) {
    const { THREE } = stage;
    Object.assign(this, { stage, timeline, body, meshes: 0, next: 0 });
    this.material = new THREE.MeshLambertMaterial({ color: COLOR, transparent: true,
      opacity: OPACITY, depthWrite: false });
    this.twin = new THREE.Group();
    this.ellipsoid = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16),
      new THREE.MeshLambertMaterial({ color: COLOR, transparent: true, opacity: 0.22,
        depthWrite: false }));
    stage.group.add(this.twin, this.ellipsoid);
  }

  // now: the drone's true state.
  draw(now, visible, wall) {
    const { estimates } = this.timeline;
    const there = visible && last(estimates, now.t);
    this.twin.visible = this.ellipsoid.visible = Boolean(there);
    if (!there) return;
    if (wall > this.next) {
      this.next = wall + LOOK;
      this.copyShape();
    }
    const { offset, turn, radii, axes } = this.at(now.t);
    const p = now.p.map((each, i) => each + offset[i]);
    this.twin.position.set(...p);
    this.twin.quaternion.set(...now.q).multiply(rotation(this.stage.THREE, turn));
    this.ellipsoid.position.set(...p);
    this.ellipsoid.scale.set(...radii.map((each) => Math.max(each, 0.01)));
    this.ellipsoid.quaternion.set(...axes);
  }

  // Returns the estimate at a time. Its error is taken from between two of the record; how sure it
  // is jumps with a marker that is seen.
  at(t) {
    const { estimates } = this.timeline, i = countUntil(estimates, t);
    const a = estimates[i - 1], b = estimates[i] ?? a;
    const share = b.t > a.t ? (t - a.t) / (b.t - a.t) : 0;
    const mixed = (name) => a[name].map((each, k) => each + share * (b[name][k] - each));
    return { offset: mixed("offset"), turn: mixed("turn"), radii: a.radii, axes: a.axes };
  }

  // Makes the twin look like the drone, whose meshes may still be on their way.
  copyShape() {
    const shape = this.stage.object(this.body);
    let meshes = 0;
    shape?.traverse((each) => (meshes += each.isMesh === true));
    if (meshes === this.meshes) return;
    this.meshes = meshes;
    const copy = shape.clone();
    copy.position.set(0, 0, 0);
    copy.quaternion.set(0, 0, 0, 1);
    copy.visible = true;
    copy.traverse((each) => {
      each.castShadow = false;
      if (each.isMesh) each.material = this.material;
    });
    this.twin.clear();
    this.twin.add(copy);
  }
}

// Returns the rotation of a small rotation vector (rad).
function rotation(THREE, [x, y, z]) {
  return new THREE.Quaternion(x / 2, y / 2, z / 2, 1).normalize();
}
