// The map's markers as ellipsoids, large where the map is not sure.

import { countUntil } from "airrace/timeline.js";

const MOST = 1024;

export class MapMarkers {
  constructor(stage, timeline) {
    const { THREE } = stage;
    Object.assign(this, { stage, timeline, done: 0, places: new Map() });
    const material = new THREE.MeshLambertMaterial({ color: 0xd926e6, transparent: true,
      opacity: 0.45, depthWrite: false });
    this.mesh = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 16, 10), material, MOST);
    this.mesh.count = 0;
    this.mesh.frustumCulled = false;
    this.matrix = new THREE.Matrix4();
    stage.group.add(this.mesh);
  }

  draw(t, visible) {
    this.mesh.visible = visible;
    const until = countUntil(this.timeline.maps, t);
    if (until === this.done) return;
    if (until < this.done) [this.done, this.places] = [0, new Map()];
    for (; this.done < until; this.done++) {
      for (const [id, ...ellipsoid] of this.timeline.maps[this.done].changed) {
        this.places.set(id, ellipsoid);
      }
    }
    this.mesh.count = 0;
    for (const [x, y, z, a, b, c] of this.places.values()) {
      this.matrix.makeScale(a, b, c).setPosition(x, y, z);
      this.mesh.setMatrixAt(this.mesh.count++, this.matrix);
    }
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
