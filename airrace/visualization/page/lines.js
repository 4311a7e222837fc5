// Lines of constant width on the screen. WebGL itself draws every line one pixel wide.
// Each stretch between two points is a rectangle that always faces the viewer.

const VERTEX = `
attribute vec3 here, there;
attribute vec4 color, colorThere;
uniform vec2 size;
uniform float width, near;
varying vec4 vColor;
void main() {
  vec4 a = projectionMatrix * modelViewMatrix * vec4(here, 1.0);
  vec4 b = projectionMatrix * modelViewMatrix * vec4(there, 1.0);
  // What is behind the viewer is cut off.
  if (a.w < near && b.w < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  else if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * size;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  vec4 end = position.x < 0.5 ? a : b;
  vec2 across = vec2(-along.y, along.x) * position.y + along * (2.0 * position.x - 1.0) * 0.5;
  end.xy += across * width / size * end.w;
  gl_Position = end;
  vColor = position.x < 0.5 ? color : colorThere;
}`;
const FRAGMENT = `
uniform float opacity;
varying vec4 vColor;
void main() { gl_FragColor = vec4(vColor.rgb, vColor.a * opacity); }`;
const ROW = 7; // numbers a point: x, y, z, red, green, blue, opacity

export class Line {
  // width: px. capacity: the most points.
  constructor(stage, { width, capacity, opacity = 1, through = false }) {
    const { THREE } = stage;
    this.stage = stage;
    this.count = 0;
    this.rows = new Float32Array(ROW * capacity);
    this.buffer = new THREE.InstancedInterleavedBuffer(this.rows, ROW, 1);
    const geometry = new THREE.InstancedBufferGeometry();
    const corners = new Float32Array([0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0]);
    geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    for (const [name, size, offset] of [["here", 3, 0], ["color", 4, 3], ["there", 3, ROW],
      ["colorThere", 4, ROW + 3]]) {
      const attribute = new THREE.InterleavedBufferAttribute(this.buffer, size, offset);
      geometry.setAttribute(name, attribute);
    }
    geometry.instanceCount = 0;
    this.material = new THREE.ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthWrite: false,
      depthTest: !through,
      side: THREE.DoubleSide,
      uniforms: {
        size: { value: new THREE.Vector2(1, 1) },
        width: { value: width },
        near: { value: 0.05 },
        opacity: { value: opacity },
      },
    });
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.onBeforeRender = () => {
      const { clientWidth, clientHeight } = stage.canvas, { uniforms } = this.material;
      uniforms.size.value.set(clientWidth, clientHeight);
      // A little thinner where there is little room.
      uniforms.width.value = width * Math.min(1, 0.5 + clientWidth / 1600);
    };
    stage.group.add(this.mesh);
  }

  get full() {
    return ROW * this.count >= this.rows.length;
  }

  // Adds points, each [x, y, z], of one colour, RGB from 0 to 1, or of one each.
  add(points, colors, alpha = 1) {
    const each = Array.isArray(colors[0]);
    points.forEach((point, i) => {
      const color = each ? colors[i] : colors;
      this.rows.set([...point, ...color, alpha], ROW * this.count++);
    });
    this.buffer.needsUpdate = true;
    this.draw(this.count);
  }

  // Draws the first so many points only.
  draw(count) {
    this.mesh.geometry.instanceCount = Math.max(Math.min(count, this.count) - 1, 0);
  }

  set visible(value) {
    this.mesh.visible = value;
  }

  set opacity(value) {
    this.material.uniforms.opacity.value = value;
  }

  clear() {
    this.count = 0;
    this.draw(0);
  }

  remove() {
    this.stage.group.remove(this.mesh);
    this.mesh.geometry.dispose();
    this.material.dispose();
  }
}
