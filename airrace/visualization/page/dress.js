// What makes the scene a place: sun and shadows, ground to the horizon, haze, numbers on gates.
import { rotated } from "airrace/timeline.js";

const GATE_TOP = 14.2, NUMBER = 3.4; // m, height of a number's middle, and its size
const READABLE = 18; // px, the least size of a number
const FAR = 4000; // m, that the ground reaches
const SEEN = 10; // m, from where on a drone can be seen itself
const LEAST = 34; // px, of the ring around it

// Returns a sprite with something painted on it: paint(context, size) on a square canvas.
export function painted(stage, size, paint, options = {}) {
  const { THREE } = stage;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = size;
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  const material = new THREE.SpriteMaterial({ map: texture, transparent: true, fog: false,
    depthWrite: false, ...options });
  const sprite = new THREE.Sprite(material);
  sprite.repaint = (again) => {
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, size, size);
    again(context, size);
    texture.needsUpdate = true;
  };
  sprite.repaint(paint);
  stage.group.add(sprite);
  return sprite;
}

// config: has sky, sun (a unit vector to it), and middle and size of the track.
export function light(stage, config) {
  const { THREE, viewer } = stage;
  // Meshcat's own lights stand near the origin: their glare on the ground looks like a pad.
  for (const name of ["SpotLight", "PointLightNegativeX", "PointLightPositiveX", "FillLight"]) {
    viewer.set_property(["Lights", name], "visible", false);
  }
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 1.5);
  const sun = new THREE.DirectionalLight(0xfff4e0, 2.6);
  const [x, y] = config.middle, reach = 0.5 * config.size + 20;
  sun.position.set(x + 2 * reach * config.sun[0], y + 2 * reach * config.sun[1],
    2 * reach * config.sun[2]);
  sun.target.position.set(x, y, 0);
  Object.assign(sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach,
    near: 1, far: 4 * reach });
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.radius = 4;
  sun.shadow.normalBias = 0.3;
  sun.castShadow = true;
  stage.group.add(sun, sun.target);
  const { shadowMap } = viewer.renderer;
  shadowMap.enabled = true;
  shadowMap.type = THREE.PCFSoftShadowMap;
  // Almost nothing moves: the shadows are drawn anew when something has come.
  shadowMap.autoUpdate = false;
}

// Draws the shadows anew if something has come; what is at some paths throws none: it moves.
export function drawShadows(stage, moving) {
  const { renderer } = stage.viewer, { geometries } = renderer.info.memory;
  if (geometries === stage.geometries) return;
  stage.geometries = geometries;
  for (const path of moving) stage.object(path)?.traverse((each) => (each.castShadow = false));
  renderer.shadowMap.needsUpdate = true;
  stage.redraw();
}

export function haze(stage, config) {
  const { THREE, viewer } = stage;
  const color = new THREE.Color(...config.sky.horizon);
  color.convertSRGBToLinear();
  viewer.scene.fog = new THREE.FogExp2(color, 1 / 520);
  const ground = new THREE.Mesh(
    new THREE.CircleGeometry(FAR, 64),
    new THREE.MeshLambertMaterial({ color: new THREE.Color(...config.sky.grass)
      .convertSRGBToLinear() }),
  );
  ground.position.set(config.middle[0], config.middle[1], -0.6);
  stage.group.add(ground);
  viewer.camera.far = 2 * FAR;
  viewer.camera.near = 0.1;
  viewer.camera.updateProjectionMatrix();
}

// Numbers above the gates, of which the next one is marked; from far away they are larger.
export class GateNumbers {
  constructor(stage, config) {
    Object.assign(this, { stage, next: null });
    this.sprites = config.gates.map((gate, i) => {
      const sprite = painted(stage, 128, (context) => number(context, i + 1, false));
      sprite.position.set(gate.middle[0], gate.middle[1], GATE_TOP);
      sprite.scale.set(NUMBER, NUMBER, 1);
      return sprite;
    });
  }

  // Makes each as large as it takes to be read from where the camera is.
  fit() {
    const { camera } = this.stage.viewer, { clientHeight } = this.stage.canvas;
    const share = (2 * Math.tan((camera.fov * Math.PI) / 360) * READABLE) / Math.max(clientHeight, 1);
    for (const sprite of this.sprites) {
      const { x, y } = sprite.position;
      const away = this.stage.world([x, y, GATE_TOP]).distanceTo(camera.position);
      const size = Math.max(NUMBER, share * away);
      sprite.scale.set(size, size, 1);
      sprite.position.z = GATE_TOP + 0.5 * (size - NUMBER);
    }
  }

  show(next, shifts) {
    if (shifts) {
      this.sprites.forEach((sprite, i) => {
        sprite.position.set(shifts[i][0], shifts[i][1], GATE_TOP);
      });
    }
    if (next === this.next) return;
    for (const gate of [this.next, next]) {
      if (gate) this.sprites[gate - 1].repaint((context) => number(context, gate, gate === next));
    }
    this.next = next;
  }
}

function number(context, text, isNext) {
  context.beginPath();
  context.arc(64, 64, 56, 0, 2 * Math.PI);
  context.fillStyle = isNext ? "#ffd21f" : "rgba(18, 28, 40, 0.82)";
  context.fill();
  context.lineWidth = 6;
  context.strokeStyle = isNext ? "#101820" : "#ffffff";
  context.stroke();
  context.fillStyle = isNext ? "#101820" : "#ffffff";
  context.font = `700 ${text > 99 ? 52 : 68}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(String(text), 64, 69);
}

// What shows where a drone is, however far: a ring around it, which keeps its size on the screen, and
// in the ring a dart as on the map, until the drone itself can be seen; and the drone's shadow.
export class Halo {
  constructor(stage, color) {
    const { THREE } = stage;
    this.stage = stage;
    [this.ring, this.dart] = [0, 1].map(() => {
      return painted(stage, 128, () => {}, { depthTest: false, sizeAttenuation: false });
    });
    [this.ring.renderOrder, this.dart.renderOrder] = [10, 11];
    this.paint(color);
    this.shadow = new THREE.Mesh(
      new THREE.CircleGeometry(1, 24),
      new THREE.MeshBasicMaterial({ color: 0x0a140a, transparent: true, depthWrite: false,
        polygonOffset: true, polygonOffsetFactor: -4, polygonOffsetUnits: -4 }),
    );
    stage.group.add(this.shadow);
  }

  paint(color) {
    this.dart.repaint((context) => dart(context, color));
    this.ring.repaint((context) => {
      context.strokeStyle = "rgba(10, 16, 24, 0.55)";
      context.lineWidth = 18;
      context.beginPath();
      context.arc(64, 64, 50, 0, 2 * Math.PI);
      context.stroke();
      context.strokeStyle = color;
      context.lineWidth = 9;
      context.stroke();
    });
  }

  // p, q: of the drone. near: whether it is so near that it needs nothing around it.
  place({ p, q }, near) {
    const { stage } = this, { camera } = stage.viewer;
    const size = 2 * Math.tan((camera.fov * Math.PI) / 360) * this.share;
    for (const sprite of [this.ring, this.dart]) {
      sprite.visible = !near;
      sprite.position.set(...p);
      sprite.scale.set(size, size, 1);
    }
    const nose = rotated(q, [1, 0, 0]).map((each, k) => each + p[k]);
    const [a, b] = [stage.onScreen(p), stage.onScreen(nose)];
    this.dart.material.rotation = Math.atan2(b.y - a.y, (b.x - a.x) * stage.aspect);
    const away = stage.world(p).distanceTo(camera.position);
    this.dart.material.opacity = Math.min(Math.max((away - SEEN) / SEEN, 0), 1);
    const height = Math.max(p[2], 0), radius = 0.35 + 0.04 * height;
    this.shadow.position.set(p[0], p[1], 0.03);
    this.shadow.scale.set(radius, radius, 1);
    this.shadow.material.opacity = 0.5 / (1 + 0.15 * height);
  }

  // What of the window's height it takes: 5 %, or of its width if that is less; on a phone, more.
  get share() {
    const { aspect, canvas } = this.stage;
    return Math.max(0.05 * Math.min(1, aspect), LEAST / Math.max(canvas.clientHeight, 1));
  }
}

function dart(context, color) {
  context.beginPath();
  for (const [x, y] of [[98, 64], [40, 92], [50, 64], [40, 36]]) context.lineTo(x, y);
  context.closePath();
  context.lineJoin = "round";
  context.lineWidth = 10;
  context.strokeStyle = "#101820";
  context.fillStyle = color;
  context.stroke();
  context.fill();
}
