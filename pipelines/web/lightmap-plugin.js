/**
 * Shows light baked by texelwalk in three.js: a plugin for GLTFLoader. Copy this one file into your project.
 *
 *     const loader = new GLTFLoader();
 *     loader.register((parser) => new LightmapPlugin(parser));
 *     const gltf = await loader.loadAsync('out/room.glb');
 *     gltf.scene.traverse((object) => { if (object.isLight) object.visible = false; }); // their light is in the bake
 *
 * In, lightmaps: materials with `MOZ_lightmap` (texture `index`, `texCoord`, `intensity`), whose texture names an EXR in
 * `extras.lightmap.uri`. Its texel × intensity is irradiance E [lx]; three.js wants E in `material.lightMap`.
 * In, light by normal (`--directional sh`): `extras.lightmap.directional` of that texture names four more EXR; then light follows
 * normal maps.
 * In, vertex light: a mesh attribute `_LIGHTMAP` (three floats a vertex), and `extras.lightmap` of the scene or the
 * document: `{"version": 1, "quantity": "radiosity" | "irradiance", "attribute": "_LIGHTMAP"}`. Radiosity, the default,
 * is E/π, irradiance is E.
 * Out: lit materials that reflect base colour × (1 − metallic) × E/π, as `texelwalk render` does.
 *
 * Why shaders are patched: three.js takes the share of the highlights off all light from around (2 to 3 % in our fixtures,
 * 10 % at grazing angles), and multiplies it by occlusion maps, which the bake has in it already. `{ plain: true }`
 * leaves lightmaps to three.js as they are; vertex light always needs the patch.
 *
 * Invariants: a page is loaded once, whatever the number of materials. Pages have no mip-maps, which would bleed from
 * chart to chart, and are clamped. Without a normal map, light by normal is the lightmap again. Unlit materials stay as they are. A material has a lightmap or vertex light; if a
 * document gives both, the lightmap counts.
 * Limits: WebGLRenderer, three.js r187 (older releases may lack `diffuseContribution`). `KHR_texture_transform` inside
 * `MOZ_lightmap` is refused. Light by normal holds for models as they were baked: turned ones keep the light of before. Materials that you clone lose the patch, as three.js does not copy `onBeforeCompile`.
 */

import { ClampToEdgeWrapping, LinearFilter, LoaderUtils, REVISION, ShaderChunk } from 'three';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';

/** By material: `set(factor)` for its baked light; for vertex light also `attribute` and `scale`, which makes it E. */
const baked = new WeakMap();

/** Textures of light by normal: light = l0 + l1x·n.x + l1y·n.y + l1z·n.z, n in the world. */
const COEFFICIENTS = ['l0', 'l1x', 'l1y', 'l1z'];

/** Multiplies all baked light under `root` by `factor`: 0 switches it off, 1 is as baked. */
export function setBakedLight(root, factor) {
  root.traverse((object) => {
    for (const material of [object.material].flat()) baked.get(material)?.set(factor);
  });
}

/** `{ attribute, scale }` of a material with vertex light: attribute × scale is irradiance [lx]. Else undefined. */
export function vertexLightOf(material) {
  const light = baked.get(material);
  return light?.attribute ? light : undefined;
}

export class LightmapPlugin {
  /**
   * `options.plain`: do not patch the shaders of lightmapped materials. `options.directional`: false leaves light by normal
   * on the server, for four times less to load.
   */
  constructor(parser, options = {}) {
    this.name = 'MOZ_lightmap';
    this.parser = parser;
    this.plain = options.plain ?? false;
    this.directional = (options.directional ?? true) && !this.plain;
    /** Promised textures, by URI and by URI and texture coordinate set. */
    this.files = new Map();
    this.pages = new Map();
    /** Lightmap textures that this plugin made. */
    this.textures = new Set();
    /** Their textures of light by normal, in the order of COEFFICIENTS. */
    this.byNormal = new Map();
    /** Materials with vertex light, by the material they were cloned from. */
    this.vertexLit = new Map();
  }

  /** GLTFLoader calls this for every lit material, before it is made. */
  async extendMaterialParams(index, params) {
    const definition = this.parser.json.materials[index];
    const reference = definition.extensions?.MOZ_lightmap;
    if (!reference) return;
    const where = `material ${index} (${definition.name ?? 'unnamed'})`;
    params.lightMap = await this.page(reference, where);
    params.lightMapIntensity = reference.intensity ?? 1;
  }

  /** GLTFLoader calls this when everything is loaded. */
  async afterRoot(gltf) {
    for (const scene of gltf.scenes) {
      const manifest = scene.userData.lightmap ?? this.parser.json.extras?.lightmap ?? {};
      scene.traverse((object) => {
        if (object.isMesh) this.finish(object, manifest);
      });
    }
  }

  /** The page that a material refers to, ready for its texture coordinate set. */
  page(reference, where) {
    if (reference.extensions?.KHR_texture_transform) {
      throw new Error(`${where}: a lightmap with KHR_texture_transform is not supported; bake without it`);
    }
    const uri = this.parser.json.textures?.[reference.index]?.extras?.lightmap?.uri;
    if (typeof uri !== 'string') {
      throw new Error(`${where}: texture ${reference.index} names no EXR in extras.lightmap.uri; bake with texelwalk`);
    }
    const channel = reference.texCoord ?? 0;
    return remember(this.pages, `${channel} ${uri}`, async () => {
      const file = await this.file(uri, where);
      const texture = file.clone(); // shares the texels
      texture.channel = channel;
      this.textures.add(texture);
      const { directional } = this.parser.json.textures[reference.index].extras.lightmap;
      if (this.directional && directional?.mode === 'sh') {
        const files = COEFFICIENTS.map((name) => this.file(directional[name], where));
        this.byNormal.set(texture, await Promise.all(files));
      }
      return texture;
    });
  }

  file(uri, where) {
    return remember(this.files, uri, () => this.load(uri, where));
  }

  async load(uri, where) {
    const { manager, path, requestHeader, crossOrigin } = this.parser.options;
    const loader = new EXRLoader(manager).setCrossOrigin(crossOrigin).setRequestHeader(requestHeader ?? {});
    let texture;
    try {
      texture = await loader.loadAsync(LoaderUtils.resolveURL(uri, path));
    } catch (error) {
      throw new Error(`${where}: cannot load the lightmap ${uri}: ${error.message ?? error}`, { cause: error });
    }
    texture.name = uri;
    texture.generateMipmaps = false;
    texture.minFilter = texture.magFilter = LinearFilter;
    texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
    // glTF puts v = 0 at the top row; EXRLoader hands over the bottom row first.
    texture.repeat.y = -1;
    texture.offset.y = 1;
    return texture;
  }

  finish(mesh, manifest) {
    const { material, geometry } = mesh;
    if (this.textures.has(material.lightMap)) {
      const { channel } = material.lightMap;
      if (!geometry.attributes[channel === 0 ? 'uv' : `uv${channel}`]) {
        throw new Error(`mesh ${mesh.name}: its material has a lightmap on TEXCOORD_${channel}, which the mesh lacks`);
      }
      if (!baked.has(material)) this.finishLightmapped(material);
      return;
    }
    const name = (manifest.attribute ?? '_LIGHTMAP').toLowerCase(); // as GLTFLoader spells it
    const attribute = geometry.attributes[name];
    if (!attribute || !material.isMeshStandardMaterial) return;
    if (attribute.itemSize !== 3 || !/^(_[a-z0-9]+)+$/.test(name)) {
      throw new Error(`mesh ${mesh.name}: attribute ${name} is not usable as light; it must be a VEC3, called _LIGHTMAP`);
    }
    mesh.material = this.vertexLitMaterial(material, name, manifest.quantity ?? 'radiosity');
  }

  finishLightmapped(material) {
    const intensity = material.lightMapIntensity;
    baked.set(material, { set: (factor) => { material.lightMapIntensity = intensity * factor; } });
    if (this.plain) return;
    const byNormal = this.byNormal.get(material.lightMap);
    material.onBeforeCompile = (shader) => {
      const maps = replaced(ShaderChunk.lights_fragment_maps, 'irradiance += lightMapIrradiance;', '');
      shader.fragmentShader = replaced(shader.fragmentShader, '#include <lights_fragment_maps>', maps);
      const light = byNormal ? lightByNormal(shader, byNormal) : 'texture2D( lightMap, vLightMapUv ).rgb';
      reflect(shader, `${light} * lightMapIntensity`);
    };
    material.customProgramCacheKey = () => (byNormal ? 'texelwalk lightmap by normal' : 'texelwalk lightmap');
  }

  vertexLitMaterial(original, name, quantity) {
    const scale = { radiosity: Math.PI, irradiance: 1 }[quantity];
    if (scale === undefined) {
      throw new Error(`extras.lightmap: the quantity ${quantity} is not known; it must be radiosity or irradiance`);
    }
    const key = `${original.uuid} ${name} ${quantity}`;
    if (this.vertexLit.has(key)) return this.vertexLit.get(key);
    const material = original.clone();
    const bakedScale = { value: scale };
    baked.set(material, { attribute: name, scale, set: (factor) => { bakedScale.value = scale * factor; } });
    material.onBeforeCompile = (shader) => {
      shader.uniforms.bakedScale = bakedScale;
      const common = '#include <common>';
      const begin = '#include <begin_vertex>';
      const vertex = replaced(shader.vertexShader, common, `${common}\nattribute vec3 ${name};\nvarying vec3 vBaked;`);
      shader.vertexShader = replaced(vertex, begin, `${begin}\nvBaked = ${name};`);
      const declared = `${common}\nuniform float bakedScale;\nvarying vec3 vBaked;`;
      shader.fragmentShader = replaced(shader.fragmentShader, common, declared);
      reflect(shader, 'vBaked * bakedScale');
    };
    material.customProgramCacheKey = () => `texelwalk vertex ${name}`;
    this.vertexLit.set(key, material);
    return material;
  }
}

/** Declares the textures; a GLSL expression of the light for the normal of the pixel, that of a front on backs, too. */
function lightByNormal(shader, textures) {
  const common = '#include <common>';
  textures.forEach((texture, k) => { shader.uniforms[`baked_${COEFFICIENTS[k]}`] = { value: texture }; });
  const samplers = COEFFICIENTS.map((name) => `uniform sampler2D baked_${name};`).join('\n');
  const read = (name) => `texture2D( baked_${name}, uv ).rgb`;
  const sum = `${read('l0')} + ${read('l1x')} * n.x + ${read('l1y')} * n.y + ${read('l1z')} * n.z`;
  const added = `${common}\n${samplers}\nvec3 bakedLight( vec2 uv, vec3 n ) { return max( ${sum}, vec3( 0.0 ) ); }`;
  shader.fragmentShader = replaced(shader.fragmentShader, common, added);
  return 'bakedLight( vLightMapUv, inverseTransformDirection( normal * faceDirection, viewMatrix ) )';
}

/** Adds diffusely reflected light, behind the occlusion map. `irradiance` is a GLSL expression [lx]. */
function reflect(shader, irradiance) {
  const after = '#include <aomap_fragment>';
  const added = `reflectedLight.indirectDiffuse += ${irradiance} * BRDF_Lambert( material.diffuseContribution );`;
  shader.fragmentShader = replaced(shader.fragmentShader, after, `${after}\n${added}`);
}

function replaced(source, what, by) {
  if (!source.includes(what)) {
    throw new Error(`lightmap-plugin.js: '${what}' is not in the shaders of three.js r${REVISION}; it was written for r187`);
  }
  return source.replace(what, () => by);
}

function remember(map, key, make) {
  if (!map.has(key)) map.set(key, make());
  return map.get(key);
}
