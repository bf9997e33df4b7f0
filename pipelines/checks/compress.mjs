// Compresses a glTF as pipelines do, and compares what two files hold, decoded by the formats' reference decoders.
//
//   node compress.mjs make INPUT OUTPUT HOW     HOW: one of STEPS
//   node compress.mjs same INPUT BAKED          every corner of every triangle of INPUT is in BAKED, bit for bit
//
// In: files that glTF-Transform reads with the decoders of meshoptimizer and Google's Draco. Out: exit code 0; 1 and a
// sentence on stderr if something differs. TEXCOORD_1, and the order of triangles, are free.
// Packages are found beside the working directory, the one of environment.py.
import { createRequire } from 'node:module';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const require = createRequire(path.join(process.cwd(), 'package.json'));
const load = async (name) => import(pathToFileURL(require.resolve(name)));
const { NodeIO } = await load('@gltf-transform/core');
const { ALL_EXTENSIONS } = await load('@gltf-transform/extensions');
const functions = await load('@gltf-transform/functions');
const { MeshoptDecoder, MeshoptEncoder } = await load('meshoptimizer');
const draco3d = require('draco3dgltf');
const sharp = require('sharp');

const STEPS = {
  draco: [functions.draco()],
  'draco-sequential': [functions.draco({ method: 'sequential' })],
  meshopt: [functions.meshopt({ encoder: MeshoptEncoder, level: 'high' })],
  quantize: [functions.quantize()],
  weld: [functions.weld()],
  join: [functions.flatten(), functions.join()],
  instance: [functions.dedup(), functions.instance({ min: 2 })],
  webp: [functions.textureCompress({ encoder: sharp, targetFormat: 'webp' })],
};

async function io() {
  await MeshoptDecoder.ready;
  await MeshoptEncoder.ready;
  return new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
    'draco3d.decoder': await draco3d.createDecoderModule(),
    'draco3d.encoder': await draco3d.createEncoderModule(),
    'meshopt.decoder': MeshoptDecoder,
    'meshopt.encoder': MeshoptEncoder,
  });
}

async function make(input, output, how) {
  const reader = await io();
  const document = await reader.read(input);
  document.setLogger({ debug() {}, info() {}, warn() {}, error: console.error });
  await document.transform(...STEPS[how], functions.unpartition());
  await reader.write(output, document);
}

// Places of the corners of a triangle in a list, a strip or a fan, by mode. Points and lines have none.
const CORNERS = { 4: (k) => [3 * k, 3 * k + 1, 3 * k + 2], 5: (k) => [k, k + 1 + (k % 2), k + 2 - (k % 2)], 6: (k) => [k + 1, k + 2, 0] };

// Every corner of a node's triangles as text, three to a line, the least first, in a stable order. Triangles of strips that
// have a vertex twice are none.
function triangles(node, wanted) {
  const lines = [];
  for (const primitive of node.getMesh().listPrimitives()) {
    const mode = primitive.getMode();
    if (!CORNERS[mode]) continue;
    const indices = primitive.getIndices();
    const attributes = wanted(primitive).map((name) => [name, primitive.getAttribute(name)]);
    const count = indices ? indices.getCount() : primitive.getAttribute('POSITION').getCount();
    const vertexOf = (k) => (indices ? indices.getScalar(k) : k);
    const corner = (vertex) => {
      // What lacks texture coordinates gets zeros, since numbers of sets must not leave gaps.
      const missing = (name) => (name === 'TEXCOORD_0' ? '0 0' : `no ${name}`);
      return attributes.map(([name, a]) => (a ? a.getElement(vertex, []).join(' ') : missing(name))).join(' / ');
    };
    for (let k = 0; k < (mode === 4 ? Math.floor(count / 3) : count - 2); k += 1) {
      const [a, b, c] = CORNERS[mode](k).map(vertexOf);
      if (mode !== 4 && (a === b || b === c || c === a)) continue;
      const texts = [corner(a), corner(b), corner(c)];
      const least = texts.indexOf([...texts].sort()[0]);
      lines.push([0, 1, 2].map((i) => texts[(least + i) % 3]).join(' | '));
    }
  }
  return lines.sort();
}

// Places of a node's mesh.
function copies(node) {
  const instances = node.getExtension('EXT_mesh_gpu_instancing');
  return instances ? instances.getAttribute(instances.listSemantics()[0]).getCount() : 1;
}

// Where instances became nodes, which node is whose is not asked: all triangles of all of them are the same.
function sameWithCopies(input, old, fresh) {
  const primitives = old.flatMap((node) => node.getMesh().listPrimitives());
  const names = new Set(primitives.flatMap((p) => p.listSemantics()));
  names.delete('TEXCOORD_1'); // That of the lightmap.
  const wanted = () => [...names].sort();
  const all = (nodes) => nodes.flatMap((node) => Array(copies(node)).fill(triangles(node, wanted)).flat()).sort();
  const [before, after] = [all(old), all(fresh)];
  const at = before.findIndex((line, k) => line !== after[k]);
  if (at >= 0 || before.length !== after.length) {
    return `${before.length} and ${after.length} triangles; ${before[at]} became ${after[at]}`;
  }
  console.log(`${path.basename(input)}: ${3 * before.length} corners of all copies are the same`);
  return before.length ? null : 'nothing was compared';
}

async function same(input, baked) {
  const [a, b] = [await (await io()).read(input), await (await io()).read(baked)];
  const nodes = (document) => document.getRoot().listNodes().filter((n) => n.getMesh());
  const [old, fresh] = [nodes(a), nodes(b)];
  if (old.some((node) => copies(node) > 1)) return sameWithCopies(input, old, fresh);
  if (old.length !== fresh.length) return `${old.length} nodes with meshes became ${fresh.length}`;
  let corners = 0;
  for (const [i, node] of old.entries()) {
    const names = new Set(node.getMesh().listPrimitives().flatMap((p) => p.listSemantics()));
    names.delete('TEXCOORD_1'); // That of the lightmap, which may be new.
    const wanted = () => [...names].sort();
    const [before, after] = [triangles(node, wanted), triangles(fresh[i], wanted)];
    const at = before.findIndex((line, k) => line !== after[k]);
    if (at >= 0 || before.length !== after.length) {
      return `node ${i} (${node.getName()}): ${before.length} and ${after.length} triangles; ${before[at]} became ${after[at]}`;
    }
    corners += 3 * before.length;
  }
  console.log(`${path.basename(input)}: ${corners} corners are the same`);
  return corners ? null : 'nothing was compared';
}

const [, , what, ...rest] = process.argv;
const fault = what === 'make' ? await make(...rest) : await same(...rest);
if (what !== 'make' && fault) {
  console.error(`error: ${fault}`);
  process.exit(1);
}
