// The cloud on a canvas, by three.js. Loaded when a model is shown, not before.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Scene,
  WebGLRenderer,
} from 'three';
import { boundsOf } from './colmap';
import { edgesOf, isInside, type Box } from './cut_box';
import { frusta, upOf, type Model } from './model';
import { eyeOf, keyed, moved, nearer, pick, rotate, turned, upright, type Orbit, type Vector } from './orbit';

const fieldOfView = 50;
const radians = (fieldOfView * Math.PI) / 180;
const slow = 60; // ms a frame, from which on a moving cloud is drawn with fewer points

export interface Picked {
  index: number;
}

export class CloudViewer {
  private renderer: WebGLRenderer;
  private scene = new Scene();
  private camera = new PerspectiveCamera(fieldOfView, 1, 0.01, 1000);
  private points: Points<BufferGeometry, PointsMaterial> | undefined;
  private cameras: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private marks: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private positions = new Float32Array(0); // upright
  private order = new Uint32Array(0); // in which points are drawn
  private shown = 0; // of them
  private box: Box | undefined;
  private frame: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private rotation: number[] = [1, 0, 0, 0, 1, 0, 0, 0, 1];
  private radius = 1;
  private orbit: Orbit = { target: [0, 0, 0], distance: 3, yaw: 0, pitch: 0 };
  private home: Orbit = this.orbit;
  private asked = 0;
  private lastFrame = 0;
  private frameMs = 0;
  private moving: ReturnType<typeof setTimeout> | undefined;
  private fingers = new Map<number, { x: number; y: number }>();
  private travelled = 0;
  private observer: ResizeObserver;
  private release: (() => void)[] = [];
  onPick: (index: number) => void = () => undefined;
  onFrame: (ms: number, drawn: number) => void = () => undefined;

  // Throws where the browser has no WebGL.
  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({
      canvas,
      antialias: false,
      alpha: true,
      powerPreference: 'high-performance',
    });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas);
    const on = <K extends keyof HTMLElementEventMap>(
      name: K,
      use: (event: HTMLElementEventMap[K]) => void,
      options?: AddEventListenerOptions,
    ) => {
      canvas.addEventListener(name, use, options);
      this.release.push(() => canvas.removeEventListener(name, use, options));
    };
    on('pointerdown', (event) => this.down(event));
    on('pointermove', (event) => this.move(event));
    on('pointerup', (event) => this.up(event));
    on('pointercancel', (event) => this.fingers.delete(event.pointerId));
    on('contextmenu', (event) => event.preventDefault());
    on(
      'wheel',
      (event) => {
        event.preventDefault();
        this.look(nearer(this.orbit, Math.exp(Math.sign(event.deltaY) * 0.12), this.radius));
      },
      { passive: false },
    );
    on('keydown', (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const next =
        event.key === '0' ? this.home : keyed(this.orbit, event.key, event.shiftKey, this.radius, radians);
      if (!next) return;
      event.preventDefault();
      this.look(next);
    });
    this.resize();
  }

  // `positions`: uprightPositions(model).
  show(model: Model, positions: Float32Array<ArrayBuffer>, pointSize: number): void {
    this.clear();
    const { cloud } = model;
    this.rotation = upright(upOf(model.photographs.values()));
    this.positions = positions;
    const bounds = boundsOf(this.positions);
    this.radius = bounds.radius;
    this.camera.near = bounds.radius / 1000;
    this.camera.far = bounds.radius * 200;

    // Drawn in an order without a pattern, so that the first points alone show the whole.
    const order = Uint32Array.from({ length: cloud.count }, (_, i) => i);
    let seed = 1;
    for (let i = order.length - 1; i > 0; i--) {
      seed = (Math.imul(seed, 1103515245) + 12345) >>> 0;
      const j = seed % (i + 1);
      const held = order[i]!;
      order[i] = order[j]!;
      order[j] = held;
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(this.positions, 3));
    const colours = new Float32Array(cloud.colours.length);
    const colour = new Color();
    for (let i = 0; i < cloud.count; i++) {
      colour.setRGB(
        cloud.colours[3 * i]! / 255,
        cloud.colours[3 * i + 1]! / 255,
        cloud.colours[3 * i + 2]! / 255,
        'srgb',
      );
      colours.set([colour.r, colour.g, colour.b], 3 * i);
    }
    geometry.setAttribute('color', new BufferAttribute(colours, 3));
    this.order = order;
    this.shown = cloud.count;
    geometry.setIndex(new BufferAttribute(order.slice(), 1));
    this.points = new Points(
      geometry,
      new PointsMaterial({ size: pointSize, sizeAttenuation: false, vertexColors: true }),
    );
    this.points.frustumCulled = false;
    this.scene.add(this.points);

    const { lines } = frusta(model, 0.08 * bounds.radius);
    for (let i = 0; i < lines.length; i += 3) {
      lines.set(rotate(this.rotation, [lines[i]!, lines[i + 1]!, lines[i + 2]!]), i);
    }
    const shape = new BufferGeometry();
    shape.setAttribute('position', new BufferAttribute(lines, 3));
    this.cameras = new LineSegments(shape, new LineBasicMaterial({ color: 0xe8912d }));
    this.cameras.frustumCulled = false;
    this.scene.add(this.cameras);

    // From behind the cameras, a little above.
    let yaw = 0;
    if (lines.length >= 3) {
      let x = 0;
      let z = 0;
      for (let i = 0; i < lines.length; i += 60) {
        x += lines[i]! - bounds.centre[0];
        z += lines[i + 2]! - bounds.centre[2];
      }
      yaw = Math.atan2(x, z);
    }
    // All of it is seen in a narrow image, too.
    const distance = (2.6 * bounds.radius) / Math.min(1, this.camera.aspect);
    this.home = { target: bounds.centre, distance, yaw, pitch: 0.3 };
    this.look(this.home);
  }

  setPointSize(size: number): void {
    if (!this.points) return;
    this.points.material.size = size * Math.min(2, devicePixelRatio);
    this.ask();
  }

  showCameras(shown: boolean): void {
    if (this.cameras) this.cameras.visible = shown;
    this.ask();
  }

  // The edges of a box, and, with `only`, no other points than those in it.
  cut(box: Box | undefined, only: boolean): void {
    if (this.frame) {
      this.scene.remove(this.frame);
      this.frame.geometry.dispose();
      this.frame.material.dispose();
      this.frame = undefined;
    }
    this.box = only ? box : undefined;
    if (box) {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(edgesOf(box), 3));
      this.frame = new LineSegments(geometry, new LineBasicMaterial({ color: 0x1f7a8c }));
      this.frame.frustumCulled = false;
      this.scene.add(this.frame);
    }
    const index = this.points?.geometry.getIndex();
    if (index) {
      const all = index.array as Uint32Array;
      this.shown = 0;
      for (const i of this.order) {
        if (!this.box || isInside(this.positions, this.box, i)) all[this.shown++] = i;
      }
      index.needsUpdate = true;
    }
    this.ask();
  }

  // Crosses at these points, and a line between two of them.
  mark(indices: readonly number[]): void {
    if (this.marks) {
      this.scene.remove(this.marks);
      this.marks.geometry.dispose();
      this.marks.material.dispose();
      this.marks = undefined;
    }
    if (indices.length > 0) {
      const arm = 0.025 * this.orbit.distance;
      const all: number[] = [];
      const at = (i: number): Vector => [
        this.positions[3 * i]!,
        this.positions[3 * i + 1]!,
        this.positions[3 * i + 2]!,
      ];
      for (const i of indices) {
        const [x, y, z] = at(i);
        all.push(x - arm, y, z, x + arm, y, z, x, y - arm, z, x, y + arm, z, x, y, z - arm, x, y, z + arm);
      }
      if (indices.length === 2) all.push(...at(indices[0]!), ...at(indices[1]!));
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(new Float32Array(all), 3));
      this.marks = new LineSegments(geometry, new LineBasicMaterial({ color: 0xd6246e, depthTest: false }));
      this.marks.frustumCulled = false;
      this.marks.renderOrder = 1;
      this.scene.add(this.marks);
    }
    this.ask();
  }

  // The view by words, for buttons.
  turn(yaw: number, pitch: number): void {
    this.look(turned(this.orbit, yaw, pitch));
  }
  zoom(factor: number): void {
    this.look(nearer(this.orbit, factor, this.radius));
  }
  reset(): void {
    this.look(this.home);
  }

  dispose(): void {
    for (const one of this.release) one();
    this.observer.disconnect();
    cancelAnimationFrame(this.asked);
    clearTimeout(this.moving);
    this.clear();
    this.renderer.dispose();
  }

  private clear(): void {
    this.mark([]);
    this.cut(undefined, false);
    for (const one of [this.points, this.cameras]) {
      if (!one) continue;
      this.scene.remove(one);
      one.geometry.dispose();
      one.material.dispose();
    }
    this.points = undefined;
    this.cameras = undefined;
  }

  private look(orbit: Orbit): void {
    this.orbit = orbit;
    this.camera.position.set(...eyeOf(orbit));
    this.camera.lookAt(...orbit.target);
    if (this.moving !== undefined) clearTimeout(this.moving);
    else this.lastFrame = 0;
    this.moving = setTimeout(() => {
      this.moving = undefined;
      this.frameMs = 0;
      this.ask();
    }, 250);
    this.ask();
  }

  private ask(): void {
    if (this.asked !== 0) return;
    this.asked = requestAnimationFrame((now) => {
      this.asked = 0;
      this.render(now);
    });
  }

  private render(now: number): void {
    const isMoving = this.moving !== undefined;
    if (isMoving && this.lastFrame > 0) {
      const took = now - this.lastFrame;
      if (took < 1000) this.frameMs = this.frameMs === 0 ? took : 0.5 * (this.frameMs + took);
    }
    this.lastFrame = now;
    const all = this.shown;
    let drawn = all;
    if (isMoving && this.frameMs > slow)
      drawn = Math.max(Math.min(all, 15000), Math.round((all * slow) / this.frameMs / 2));
    this.points?.geometry.setDrawRange(0, drawn);
    this.renderer.render(this.scene, this.camera);
    this.onFrame(this.frameMs, drawn);
  }

  private resize(): void {
    const width = Math.max(1, this.canvas.clientWidth);
    const height = Math.max(1, this.canvas.clientHeight);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  private down(event: PointerEvent): void {
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.travelled = this.fingers.size > 1 ? 100 : 0;
  }

  private move(event: PointerEvent): void {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.x;
    const dy = event.clientY - before.y;
    const height = Math.max(1, this.canvas.clientHeight);
    this.travelled += Math.abs(dx) + Math.abs(dy);
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const other = others[0];
    if (other) {
      // Two fingers: apart is nearer, together moves.
      const was = Math.hypot(before.x - other.x, before.y - other.y);
      const is = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      let next = moved(this.orbit, (-0.5 * dx) / height, (0.5 * dy) / height, radians);
      if (was > 10 && is > 10) next = nearer(next, was / is, this.radius);
      this.look(next);
    } else if (event.shiftKey || (event.buttons & 6) !== 0) {
      this.look(moved(this.orbit, -dx / height, dy / height, radians));
    } else {
      this.look(turned(this.orbit, (-dx / height) * Math.PI, (dy / height) * Math.PI));
    }
  }

  private up(event: PointerEvent): void {
    const was = this.fingers.delete(event.pointerId);
    if (!was || this.travelled > 6 || event.button !== 0) return;
    const box = this.canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const matrix = new Matrix4().multiplyMatrices(
      this.camera.projectionMatrix,
      this.camera.matrixWorldInverse,
    );
    const reach = event.pointerType === 'touch' ? 22 : 9;
    const index = pick(
      this.positions,
      matrix.elements,
      box.width,
      box.height,
      event.clientX - box.left,
      event.clientY - box.top,
      reach,
      (i) => !this.box || isInside(this.positions, this.box, i),
    );
    if (index >= 0) this.onPick(index);
  }
}
