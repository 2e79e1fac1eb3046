// The cloud on a canvas, by three.js. Loaded when a model is shown, not before.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  Plane,
  Points,
  PointsMaterial,
  Scene,
  SRGBColorSpace,
  Texture,
  Vector3,
  WebGLRenderer,
} from 'three';
import { boundsOf, type Cloud } from './colmap';
import {
  alongAxis,
  edgesOf,
  faceAt,
  faces,
  handleOf,
  isInside,
  keyedFace,
  nameOfFace,
  seenAt,
  stepOf,
  type Box,
  type Face,
} from './cut_box';
import { hitOf, type Surface } from './glb';
import { frusta, upOf, type Model } from './model';
import { eyeOf, keyed, moved, nearer, pick, rotate, turned, upright, type Orbit, type Vector } from './orbit';

const fieldOfView = 50;
const radians = (fieldOfView * Math.PI) / 180;
const handleSize = 13; // px
const handleColour = 0x1f7a8c;
const chosenColour = 0xd6246e;
const slow = 60; // ms a frame, from which on a moving cloud is drawn with fewer points

/** A place on what is shown. */
export interface Place {
  at: Vector; // in the model
  index: number | null; // of the point; null: on a surface
}

/** What is shown beside the cameras: points, or a surface. */
export interface Shape {
  cloud: Cloud;
  surface?: Surface;
}

// What lies within all six of them is drawn.
const planesOf = (box: Box): Plane[] =>
  faces.map(({ axis, face }) => {
    const sign = face === 'low' ? 1 : -1;
    const normal = new Vector3().setComponent(axis, sign);
    return new Plane(normal, -sign * box[face][axis]!);
  });

// Of a rotation: its inverse.
const transposed = (r: readonly number[]): number[] => [0, 3, 6, 1, 4, 7, 2, 5, 8].map((i) => r[i]!);

export class CloudViewer {
  private renderer: WebGLRenderer;
  private scene = new Scene();
  private camera = new PerspectiveCamera(fieldOfView, 1, 0.01, 1000);
  private points: Points<BufferGeometry, PointsMaterial> | undefined;
  private surface: Mesh<BufferGeometry, MeshBasicMaterial> | undefined;
  private surfaceFaces: Uint32Array = new Uint32Array(0); // three vertices each
  private cameras: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private marks: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private positions = new Float32Array(0); // upright
  private order = new Uint32Array(0); // in which points are drawn
  private shown = 0; // of them
  private box: Box | undefined; // points outside are not drawn
  private cutBox: Box | undefined; // that has edges and handles
  private whole: Box | undefined;
  private frame: LineSegments<BufferGeometry, LineBasicMaterial> | undefined;
  private handles: Points<BufferGeometry, PointsMaterial> | undefined;
  private chosen: Face | null = null;
  private dragged: { pointer: number; face: Face; start: number; from: number } | undefined;
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
  onPick: (place: Place) => void = () => undefined;
  onFrame: (ms: number, drawn: number) => void = () => undefined;
  // A face of the cut box is dragged, or moved by keys, to this place on its axis.
  onFace: (face: Face, value: number) => void = () => undefined;
  // The surface has its texture.
  onTexture: () => void = () => undefined;
  // Which face keys move now.
  onChosen: (face: Face | null) => void = () => undefined;

  // Throws where the browser has no WebGL.
  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({
      canvas,
      antialias: false,
      alpha: true,
      powerPreference: 'high-performance',
    });
    this.renderer.localClippingEnabled = true;
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
    on('pointercancel', (event) => {
      this.fingers.delete(event.pointerId);
      if (this.dragged?.pointer === event.pointerId) this.dragged = undefined;
    });
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
      if (this.keyBox(event.key)) {
        event.preventDefault();
        event.stopPropagation();
        return;
      }
      const next =
        event.key === '0' ? this.home : keyed(this.orbit, event.key, event.shiftKey, this.radius, radians);
      if (!next) return;
      event.preventDefault();
      this.look(next);
    });
    this.resize();
  }

  // `positions`: upright, of the shape's cloud. What was shown before goes; the view stays.
  show(
    model: Model,
    { cloud, surface }: Shape,
    positions: Float32Array<ArrayBuffer>,
    pointSize: number,
  ): void {
    const first = this.cameras === undefined;
    this.clear();
    this.rotation = upright(upOf(model.images.values()));
    this.positions = positions;
    if (surface) this.addSurface(surface);
    else this.addPoints(cloud, pointSize);
    if (first) this.addCameras(model);
    this.ask();
  }

  private addPoints(cloud: Cloud, size: number): void {
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
    const geometry = this.geometryOf(cloud);
    this.order = order;
    this.shown = cloud.count;
    geometry.setIndex(new BufferAttribute(order.slice(), 1));
    this.points = new Points(geometry, new PointsMaterial({ sizeAttenuation: false, vertexColors: true }));
    this.points.frustumCulled = false;
    this.scene.add(this.points);
    this.setPointSize(size);
  }

  private addSurface({ cloud, faces, uvs, texture }: Surface): void {
    const geometry = this.geometryOf(cloud);
    geometry.setIndex(new BufferAttribute(faces, 1));
    const material = new MeshBasicMaterial({ vertexColors: true, side: DoubleSide });
    if (uvs && texture) {
      geometry.setAttribute('uv', new BufferAttribute(uvs, 2));
      // The colours of the vertices until the texture is decoded.
      createImageBitmap(new Blob([texture.bytes], { type: texture.type })).then(
        (bitmap) => {
          if (this.surface?.material !== material) return bitmap.close();
          material.map = new Texture(bitmap);
          material.map.flipY = false;
          material.map.colorSpace = SRGBColorSpace;
          material.map.needsUpdate = true;
          material.vertexColors = false;
          material.needsUpdate = true;
          this.onTexture();
          this.ask();
        },
        () => undefined,
      );
    }
    this.surfaceFaces = faces;
    this.shown = faces.length / 3;
    this.surface = new Mesh(geometry, material);
    this.surface.frustumCulled = false;
    this.scene.add(this.surface);
  }

  private geometryOf(cloud: Cloud): BufferGeometry {
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
    return geometry;
  }

  // With the first view: from behind the cameras, a little above.
  private addCameras(model: Model): void {
    const bounds = boundsOf(this.positions);
    this.radius = bounds.radius;
    this.camera.near = bounds.radius / 1000;
    this.camera.far = bounds.radius * 200;
    this.camera.updateProjectionMatrix();
    const { lines } = frusta(model, 0.08 * bounds.radius);
    for (let i = 0; i < lines.length; i += 3) {
      lines.set(rotate(this.rotation, [lines[i]!, lines[i + 1]!, lines[i + 2]!]), i);
    }
    const shape = new BufferGeometry();
    shape.setAttribute('position', new BufferAttribute(lines, 3));
    this.cameras = new LineSegments(shape, new LineBasicMaterial({ color: 0xe8912d }));
    this.cameras.frustumCulled = false;
    this.scene.add(this.cameras);

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

  // The edges of a box with a handle in each face, and, with `only`, no other points than those in it. `whole`: how far
  // its faces go.
  cut(box: Box | undefined, only: boolean, whole?: Box): void {
    for (const one of [this.frame, this.handles]) {
      if (!one) continue;
      this.scene.remove(one);
      one.geometry.dispose();
      one.material.dispose();
    }
    this.frame = this.handles = undefined;
    const before = this.box;
    this.box = only ? box : undefined;
    this.cutBox = box;
    this.whole = whole;
    if (box) {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(edgesOf(box), 3));
      this.frame = new LineSegments(geometry, new LineBasicMaterial({ color: handleColour }));
      this.frame.frustumCulled = false;
      this.scene.add(this.frame);
      this.showHandles(box);
    } else {
      this.dragged = undefined;
      this.choose(null);
    }
    if (this.surface) {
      const planes = this.box ? planesOf(this.box) : null;
      // Other shaders are needed where planes come or go.
      if ((planes === null) !== (this.surface.material.clippingPlanes === null))
        this.surface.material.needsUpdate = true;
      this.surface.material.clippingPlanes = planes;
    }
    const index = this.points?.geometry.getIndex();
    if (index && (before !== undefined || this.box !== undefined)) {
      const all = index.array as Uint32Array;
      this.shown = 0;
      for (const i of this.order) {
        if (!this.box || isInside(this.positions, this.box, i)) all[this.shown++] = i;
      }
      index.needsUpdate = true;
    }
    this.ask();
  }

  private showHandles(box: Box): void {
    const places = new Float32Array(3 * faces.length);
    const colours = new Float32Array(3 * faces.length);
    const colour = new Color();
    faces.forEach((one, i) => {
      places.set(handleOf(box, one), 3 * i);
      const isChosen = this.chosen !== null && nameOfFace(this.chosen) === nameOfFace(one);
      colour.set(isChosen ? chosenColour : handleColour);
      colours.set([colour.r, colour.g, colour.b], 3 * i);
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(places, 3));
    geometry.setAttribute('color', new BufferAttribute(colours, 3));
    this.handles = new Points(
      geometry,
      new PointsMaterial({
        size: handleSize * Math.min(2, devicePixelRatio),
        sizeAttenuation: false,
        vertexColors: true,
        depthTest: false,
      }),
    );
    this.handles.frustumCulled = false;
    this.handles.renderOrder = 2;
    this.scene.add(this.handles);
  }

  private choose(face: Face | null): void {
    if (this.chosen === face) return;
    this.chosen = face;
    this.onChosen(face);
    if (!this.cutBox || !this.handles) return;
    this.scene.remove(this.handles);
    this.handles.geometry.dispose();
    this.handles.material.dispose();
    this.showHandles(this.cutBox);
    this.ask();
  }

  // Whether the key was the box's.
  private keyBox(key: string): boolean {
    if (!this.cutBox) return false;
    const meant = keyedFace(key, this.chosen);
    if (!meant) return false;
    this.choose(meant.chosen);
    if (meant.chosen && meant.steps !== 0 && this.whole) {
      const { axis, face } = meant.chosen;
      const step = stepOf(this.whole.high[axis]! - this.whole.low[axis]!);
      this.onFace(meant.chosen, this.cutBox[face][axis]! + meant.steps * step);
    }
    return true;
  }

  // From the world to the canvas.
  private matrix(): readonly number[] {
    this.camera.updateMatrixWorld();
    return new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse)
      .elements;
  }

  // Where the handles of the cut box are seen, px of the canvas.
  handlePlaces(): Record<string, [number, number]> {
    const places: Record<string, [number, number]> = {};
    if (!this.cutBox) return places;
    const matrix = this.matrix();
    for (const one of faces) {
      const seen = seenAt(
        handleOf(this.cutBox, one),
        matrix,
        this.canvas.clientWidth,
        this.canvas.clientHeight,
      );
      if (seen) places[nameOfFace(one)] = [Math.round(seen.x), Math.round(seen.y)];
    }
    return places;
  }

  private faceUnder(event: PointerEvent): Face | null {
    if (!this.cutBox) return null;
    const box = this.canvas.getBoundingClientRect();
    const reach = event.pointerType === 'touch' ? 24 : 12;
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    return faceAt(this.cutBox, this.matrix(), box.width, box.height, x, y, reach);
  }

  // The line of sight of a pointer: the eye, and a direction of any length.
  private sightOf(event: PointerEvent): { eye: Vector; ray: Vector } {
    const box = this.canvas.getBoundingClientRect();
    const to = new Vector3(
      (2 * (event.clientX - box.left)) / Math.max(1, box.width) - 1,
      1 - (2 * (event.clientY - box.top)) / Math.max(1, box.height),
      0.5,
    );
    this.camera.updateMatrixWorld();
    const ray = to.unproject(this.camera).sub(this.camera.position);
    const { x, y, z } = this.camera.position;
    return { eye: [x, y, z], ray: [ray.x, ray.y, ray.z] };
  }

  // The place on the axis of a face, from its handle, that a pointer means.
  private placeOn(face: Face, at: Vector, event: PointerEvent): number | null {
    const { eye, ray } = this.sightOf(event);
    return alongAxis(at, face.axis, eye, ray);
  }

  // Where a click meets the surface; with a cut box that hides the rest, in the box.
  private surfaceUnder(event: PointerEvent): Place | null {
    const { eye, ray } = this.sightOf(event);
    const { box } = this;
    const hit = hitOf(
      this.positions,
      this.surfaceFaces,
      eye,
      ray,
      box && ((...at) => at.every((v, axis) => v >= box.low[axis]! && v <= box.high[axis]!)),
    );
    return hit && { at: rotate(transposed(this.rotation), hit), index: null };
  }

  // Crosses at these places, and a line between two of them.
  mark(places: readonly Place[]): void {
    if (this.marks) {
      this.scene.remove(this.marks);
      this.marks.geometry.dispose();
      this.marks.material.dispose();
      this.marks = undefined;
    }
    if (places.length > 0) {
      const arm = 0.025 * this.orbit.distance;
      const all: number[] = [];
      const seen = places.map((one) => rotate(this.rotation, one.at));
      for (const [x, y, z] of seen)
        all.push(x - arm, y, z, x + arm, y, z, x, y - arm, z, x, y + arm, z, x, y, z - arm, x, y, z + arm);
      if (seen.length === 2) all.push(...seen[0]!, ...seen[1]!);
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
    this.cameras?.geometry.dispose();
    this.cameras?.material.dispose();
    this.renderer.dispose();
  }

  // What is shown goes, but for the cameras.
  private clear(): void {
    this.mark([]);
    this.cut(undefined, false);
    this.surface?.material.map?.dispose();
    for (const one of [this.points, this.surface]) {
      if (!one) continue;
      this.scene.remove(one);
      one.geometry.dispose();
      one.material.dispose();
    }
    this.points = undefined;
    this.surface = undefined;
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
    if (this.points && isMoving && this.frameMs > slow)
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
    this.render(performance.now()); // in the same frame: a canvas of a new size is empty
  }

  private down(event: PointerEvent): void {
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    const face = event.button === 0 && this.fingers.size === 0 ? this.faceUnder(event) : null;
    if (face && this.cutBox) {
      const from = this.placeOn(face, handleOf(this.cutBox, face), event) ?? 0;
      this.dragged = { pointer: event.pointerId, face, start: this.cutBox[face.face][face.axis]!, from };
      this.choose(face);
      return;
    }
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.travelled = this.fingers.size > 1 ? 100 : 0;
  }

  // The axis is the one of the beginning, so that the handle stays under the pointer.
  private drag(event: PointerEvent, { face, start, from }: NonNullable<typeof this.dragged>): void {
    if (!this.cutBox) return;
    const at = handleOf(this.cutBox, face);
    at[face.axis] = start;
    const place = this.placeOn(face, at, event);
    if (place !== null) this.onFace(face, start + place - from);
  }

  private move(event: PointerEvent): void {
    if (this.dragged?.pointer === event.pointerId) return this.drag(event, this.dragged);
    const before = this.fingers.get(event.pointerId);
    if (!before) {
      this.canvas.style.cursor = event.buttons === 0 && this.faceUnder(event) ? 'grab' : '';
      return;
    }
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
    if (this.dragged?.pointer === event.pointerId) {
      this.dragged = undefined;
      return;
    }
    const was = this.fingers.delete(event.pointerId);
    if (!was || this.travelled > 6 || event.button !== 0) return;
    const place = this.surface ? this.surfaceUnder(event) : this.pointUnder(event);
    if (place) this.onPick(place);
  }

  private pointUnder(event: PointerEvent): Place | null {
    const box = this.canvas.getBoundingClientRect();
    const reach = event.pointerType === 'touch' ? 22 : 9;
    const index = pick(
      this.positions,
      this.matrix(),
      box.width,
      box.height,
      event.clientX - box.left,
      event.clientY - box.top,
      reach,
      (i) => !this.box || isInside(this.positions, this.box, i),
    );
    return index < 0 ? null : this.placeOf(index);
  }

  private placeOf(index: number): Place {
    const at = [0, 1, 2].map((axis) => this.positions[3 * index + axis]!) as Vector;
    return { at: rotate(transposed(this.rotation), at), index };
  }
}
