/**
 * The picture: a baked document under its own light, beside it the same without the bake.
 *
 * Left of the line stands the bake: lightmaps or vertex light and own emission; lights of the file are off, because they
 * are in the bake. Right of it, one of: `even` (light from everywhere, as bright as the mean of the bake), `lights`
 * (those of the file, without shadows), `dark` (own emission only), `charts` (charts.js).
 *
 * Exposure is 2^stops. The tone curve is that of `texelwalk render`: per channel c (1 + c/W²)/(1 + c) with W = 6; without
 * it, values are cut at 1. `radiance()` hands over linear values without both. Pictures are drawn when something changed.
 */

import {
  AmbientLight, Box3, Color, CustomToneMapping, DataUtils, FloatType, LinearSRGBColorSpace, LinearToneMapping, Matrix4,
  OrthographicCamera, PerspectiveCamera, Scene, ShaderChunk, Vector3, WebGLRenderer, WebGLRenderTarget,
} from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { chartMaterial } from './charts.js';
import { LightmapPlugin, setBakedLight, vertexLightOf } from './lightmap-plugin.js';

/** Value before the tone curve that the log-average of the picture gets, as `texelwalk render` does. */
const KEY = 0.22;
/** Linear display value of the background, as `texelwalk render` has it. */
const BACKGROUND = new Color().setRGB(0.05, 0.05, 0.05, LinearSRGBColorSpace);
const LUMINANCE = [0.2126, 0.7152, 0.0722];

const STUB = 'vec3 CustomToneMapping( vec3 color ) { return color; }';
if (!ShaderChunk.tonemapping_pars_fragment.includes(STUB)) throw new Error('this three.js has no place for a tone curve');
ShaderChunk.tonemapping_pars_fragment = ShaderChunk.tonemapping_pars_fragment.replace(STUB, `
vec3 CustomToneMapping( vec3 color ) {
  vec3 c = max( color * toneMappingExposure, 0.0 );
  return clamp( c * ( 1.0 + c / 36.0 ) / ( 1.0 + c ), 0.0, 1.0 );
}`);

export class Viewer {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.setScissorTest(true);
    this.scene = new Scene();
    this.even = new AmbientLight(0xffffff, 0);
    this.scene.add(this.even);
    this.settings = { split: 1, other: 'even', stops: 0, curve: true };
    this.camera = new PerspectiveCamera();
    new ResizeObserver(() => this.changed()).observe(canvas);
  }

  /** Replaces what is shown. `plain`: see lightmap-plugin.js. */
  async open(source, { plain = false } = {}) {
    const makeLoader = (manager) => new GLTFLoader(manager).register((parser) => new LightmapPlugin(parser, { plain }));
    const gltf = await source.load(makeLoader);
    this.close();
    this.model = gltf.scene;
    this.scene.add(this.model);
    this.model.updateMatrixWorld(true);
    this.take();
  }

  /** Takes the model away and frees its memory on the GPU. */
  close() {
    if (!this.model) return;
    this.scene.remove(this.model);
    for (const { mesh, material, charts } of this.meshes) {
      mesh.geometry.dispose();
      for (const value of Object.values(material)) if (value?.isTexture) value.dispose();
      material.dispose();
      charts?.dispose();
    }
  }

  /** Finds meshes, lights, cameras and pages of the model. */
  take() {
    this.meshes = [];
    this.lights = [];
    this.cameras = [];
    this.pages = new Map();
    this.vertexLit = 0;
    this.model.traverse((object) => {
      if (object.isCamera) this.cameras.push(object);
      if (object.isLight) this.lights.push(object);
      if (object.isMesh) this.takeMesh(object);
    });
    this.pages = new Map([...this.pages].sort(([a], [b]) => (a < b ? -1 : 1))); // not in the order of their arrival
    this.bounds = new Box3().setFromObject(this.model);
    this.even.intensity = this.meanIrradiance();
  }

  takeMesh(mesh) {
    const { material } = mesh;
    // three.js draws by numbers that materials get as their files arrive: where depths are equal, pixels would change.
    if (!material.transparent) mesh.renderOrder = this.meshes.length;
    this.meshes.push({ mesh, material });
    if (material.isMeshBasicMaterial) material.toneMapped = false; // unlit: meant for the display as it is
    if (material.map) material.map.anisotropy = this.renderer.capabilities.getMaxAnisotropy();
    const { lightMap: texture, lightMapIntensity: intensity } = material;
    if (texture) this.pages.set(texture.name, { texture, intensity });
    if (vertexLightOf(material)) this.vertexLit += 1;
  }

  /** Mean luminance of the bake [lx]: of charted texels, or of vertices. */
  meanIrradiance() {
    let [sum, count] = [0, 0];
    const add = (rgb, scale) => {
      sum += scale * LUMINANCE.reduce((y, weight, c) => y + weight * rgb(c), 0);
      count += 1;
    };
    for (const { texture, intensity } of this.pages.values()) {
      const { data } = texture.image;
      for (let i = 0; i < data.length; i += 4) {
        if (data[i + 3] > 0) add((c) => DataUtils.fromHalfFloat(data[i + c]), intensity);
      }
    }
    if (count === 0) {
      for (const { mesh, material } of this.meshes.filter((entry) => vertexLightOf(entry.material))) {
        const { attribute, scale } = vertexLightOf(material);
        const light = mesh.geometry.attributes[attribute];
        for (let v = 0; v < light.count; v += 1) add((c) => light.getComponent(v, c), scale);
      }
    }
    return count > 0 ? sum / count : 1;
  }

  /** Light at the vertices of each mesh, as the file has it: three floats a vertex. */
  vertexLight() {
    return this.meshes.filter(({ material }) => vertexLightOf(material)).map(({ mesh, material }) => {
      const light = mesh.geometry.attributes[vertexLightOf(material).attribute];
      return Float32Array.from({ length: 3 * light.count }, (_, i) => light.getComponent(Math.floor(i / 3), i % 3));
    });
  }

  /** Looks through a camera of the file, by number; without it from outside, over all of the model. */
  look(number) {
    this.controls?.dispose();
    const center = this.bounds.getCenter(new Vector3());
    const reach = Math.max(this.bounds.getSize(new Vector3()).length(), 1e-3);
    const original = this.cameras[number];
    this.camera = original ? rigid(original) : outside(center, reach);
    this.camera.near = reach * 1e-3;
    this.camera.far = this.camera.position.distanceTo(center) + 2 * reach;
    const forward = this.camera.getWorldDirection(new Vector3());
    const ahead = Math.max(center.sub(this.camera.position).dot(forward), reach * 0.05);
    const pose = this.camera.quaternion.clone();
    this.controls = new OrbitControls(this.camera, this.canvas); // turns the camera to the origin
    this.camera.quaternion.copy(pose);
    this.controls.target.copy(this.camera.position).addScaledVector(forward, ahead);
    this.controls.addEventListener('change', () => this.changed());
    this.changed();
  }

  changed() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      this.draw();
    });
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    const { split, other, stops, curve } = this.settings;
    this.renderer.setPixelRatio(window.devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.renderer.toneMapping = curve ? CustomToneMapping : LinearToneMapping;
    this.renderer.toneMappingExposure = 2 ** stops;
    this.scene.background = BACKGROUND;
    frame(this.camera, width / height);
    const line = Math.round(split * width);
    if (line > 0) this.part(0, line, height, 'baked');
    if (line < width) this.part(line, width - line, height, other);
  }

  /** Draws a vertical strip of the picture. */
  part(left, width, height, light) {
    if (!this.model) return;
    this.renderer.setScissor(left, 0, width, height);
    this.light(light);
    this.renderer.render(this.scene, this.camera);
  }

  /** Switches to `baked`, `even`, `lights`, `dark` or `charts`. */
  light(which) {
    for (const entry of this.meshes) {
      const charts = () => { entry.charts ??= chartMaterial(entry.mesh, entry.material); return entry.charts; };
      entry.mesh.material = which === 'charts' ? charts() : entry.material;
    }
    if (which !== 'charts') setBakedLight(this.model, which === 'baked' ? 1 : 0);
    this.even.visible = which === 'even';
    for (const light of this.lights) light.visible = which === 'lights';
  }

  /**
   * Radiance of the baked picture [cd/m²]: a Float32Array of R, G, B, A, top row first; A is the share of the pixel that
   * shows a surface. Pixels are the means of `strata`² evenly spread samples.
   */
  radiance({ width, height, strata = 1, light = 'baked' }) {
    const { renderer, camera, scene } = this;
    const target = new WebGLRenderTarget(width, height, { type: FloatType });
    const [sum, once] = [new Float32Array(width * height * 4), new Float32Array(width * height * 4)];
    this.light(light);
    scene.background = null;
    renderer.setClearColor(0x000000, 0);
    renderer.setRenderTarget(target);
    frame(camera, width / height);
    for (let s = 0; s < strata * strata; s += 1) {
      const offset = (index) => (index + 0.5) / strata - 0.5;
      camera.setViewOffset(width, height, offset(s % strata), offset(Math.floor(s / strata)), width, height);
      renderer.render(scene, camera);
      renderer.readRenderTargetPixels(target, 0, 0, width, height, once);
      once.forEach((value, i) => { sum[i] += value / (strata * strata); });
    }
    camera.clearViewOffset();
    renderer.setRenderTarget(null);
    target.dispose();
    this.changed();
    return upsideDown(sum, width * 4);
  }

  /** Stops that map the log-average of a small picture to KEY; far darker pixels are left out. */
  automaticStops() {
    const pixels = this.radiance({ width: 96, height: 64 });
    const values = [];
    for (let i = 0; i < pixels.length; i += 4) {
      if (pixels[i + 3] > 0) values.push(LUMINANCE.reduce((sum, weight, c) => sum + weight * pixels[i + c], 0));
    }
    const mean = values.reduce((a, b) => a + b, 0) / Math.max(values.length, 1);
    const lit = values.filter((value) => value > mean * 1e-3);
    if (lit.length === 0) return 0;
    return Math.log2(KEY) - lit.reduce((sum, value) => sum + Math.log2(value), 0) / lit.length;
  }
}

/** A camera of the document without the scale of its node, as the specification says. */
function rigid(original) {
  const camera = original.isOrthographicCamera ? new OrthographicCamera() : new PerspectiveCamera(original.fov);
  camera.userData.halfHeight = original.top;
  const [x, y, z] = [new Vector3(), new Vector3(), new Vector3()];
  original.matrixWorld.extractBasis(x, y, z);
  z.normalize();
  y.addScaledVector(z, -y.dot(z)).normalize();
  camera.quaternion.setFromRotationMatrix(new Matrix4().makeBasis(x.crossVectors(y, z), y, z));
  camera.position.setFromMatrixPosition(original.matrixWorld);
  camera.updateMatrixWorld();
  return camera;
}

function outside(center, reach) {
  const camera = new PerspectiveCamera(35);
  camera.position.copy(center).add(new Vector3(0.8, 0.6, 1).normalize().multiplyScalar(reach * 1.7));
  camera.lookAt(center);
  camera.updateMatrixWorld();
  return camera;
}

/** Fits a camera's lens to a picture; the vertical extent stays. */
function frame(camera, aspect) {
  if (camera.isOrthographicCamera) {
    camera.top = camera.userData.halfHeight;
    camera.bottom = -camera.top;
    camera.right = camera.top * aspect;
    camera.left = -camera.right;
  } else {
    camera.aspect = aspect;
  }
  camera.updateProjectionMatrix();
}

function upsideDown(pixels, row) {
  const out = new Float32Array(pixels.length);
  for (let at = 0; at < pixels.length; at += row) out.set(pixels.subarray(at, at + row), pixels.length - row - at);
  return out;
}
