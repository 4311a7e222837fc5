// Drake's Meshcat, as far as this page needs it: its tree of objects, its camera, its frames.

export class Stage {
  constructor(viewer) {
    this.viewer = viewer;
    this.THREE = MeshCat.THREE;
    this.frameTime = 0; // s, of late, from one picture to the next
    this.drawTime = 0; // s, of late, that a picture takes
    this.callbacks = [];
    this.previous = null;
    // Ours are beside Meshcat's own, in Drake's world: z is up.
    this.group = new this.THREE.Group();
    viewer.scene.add(this.group);
    viewer.animate = () => this.animate();
    // Meshcat listens for keys of its own buttons, of which there are none.
    viewer.gui.domElement.style.display = "none";
  }

  // Calls a function of the wall time and the time since the last frame (s) at every frame.
  onFrame(callback) {
    this.callbacks.push(callback);
  }

  animate() {
    const now = performance.now() / 1000;
    const dt = this.previous === null ? 0 : now - this.previous;
    this.previous = now;
    this.frameTime += 0.1 * (dt - this.frameTime);
    for (const callback of this.callbacks) callback(now, Math.min(dt, 0.5));
    this.viewer.animator.update();
    if (this.viewer.needs_render) {
      this.viewer.render();
      this.drawTime += 0.1 * (performance.now() / 1000 - now - this.drawTime);
      this.onDrawn?.();
    }
  }

  redraw() {
    this.viewer.set_dirty();
  }

  // Returns Meshcat's object at a path, or null.
  object(path) {
    let node = this.viewer.scene_tree;
    for (const name of path.split("/")) {
      node = node.children[name];
      if (!node) return null;
    }
    return node.object;
  }

  show(path, visible) {
    const object = this.object(path);
    if (object) object.visible = visible;
  }

  place(path, { p, q }) {
    const object = this.object(path);
    if (!object) return;
    object.position.set(...p);
    object.quaternion.set(...q);
  }

  // Returns a place of Drake's world as the camera's world has it, whose y is up.
  world(p) {
    return new this.THREE.Vector3(...p).applyMatrix4(this.group.matrixWorld);
  }

  // Returns where a place is seen: x and y from -1 to 1.
  onScreen(p) {
    return this.world(p).project(this.viewer.camera);
  }

  get canvas() {
    return this.viewer.renderer.domElement;
  }

  // Puts the camera somewhere in Drake's world. It is an object of a world whose y is up.
  look({ eye, target, up = [0, 0, 1], fov = 75 }) {
    const { camera, controls } = this.viewer;
    camera.up.set(up[0], up[2], -up[1]);
    camera.position.set(eye[0], eye[2], -eye[1]);
    controls.target.set(target[0], target[2], -target[1]);
    camera.lookAt(controls.target);
    if (camera.fov !== fov) {
      camera.fov = fov;
      camera.updateProjectionMatrix();
    }
    this.redraw();
  }

  get aspect() {
    return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }
}
