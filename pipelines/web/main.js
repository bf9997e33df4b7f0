/**
 * The page: connects its controls with the viewer, opens `?file=ADDRESS`, dropped and picked files.
 *
 * Addresses: `?file=` a baked glTF or GLB, `&camera=` a camera by number, `&plain` leaves shading to three.js (see
 * lightmap-plugin.js). For checks, `window.texelwalk` has `opened` (a promise that fails with what went wrong), `radiance()`,
 * `pages()` and `vertices()`.
 */

import { dropped, fromAddress, fromFiles, picked } from './files.js';
import { Viewer } from './viewer.js';

const part = (id) => document.getElementById(id);
const query = new URLSearchParams(window.location.search);
const LABELS = { even: 'even light', lights: 'lights of the file', dark: 'own emission', charts: 'charts and texels' };
const NOTES = {
  even: 'As bright as the mean of the bake, the same from everywhere.',
  lights: 'Point, spot and directional lights as they are in the file, without shadows. Glowing surfaces light nothing here.',
  dark: 'What glows by itself.',
  charts: 'A colour per chart of the lightmap, squares are its texels. Dark grey has no lightmap.',
};

/** What checks talk to. */
const hook = {
  opened: Promise.resolve(),
  set,
  pages,
  vertices: () => viewer.vertexLight().map(base64),
  radiance: (options) => base64(viewer.radiance(options)),
};
let viewer;
try {
  viewer = new Viewer(part('canvas'));
} catch (error) {
  fail(error);
}

async function open(source) {
  say(`Loading ${source.name}…`);
  await viewer.open(source, { plain: query.has('plain') });
  say('');
  describe(source.name);
  const cameras = viewer.cameras.map((camera, i) => new Option(camera.name || `Camera ${i}`, i));
  part('camera').replaceChildren(...cameras, new Option('Outside', -1));
  const camera = query.get('camera') ?? (cameras.length > 0 ? 0 : -1);
  part('camera').value = camera;
  viewer.look(Number(camera));
  viewer.settings.stops = viewer.automaticStops();
  part('controls').disabled = false;
  show();
}

/** Opens, and puts what goes wrong on the page. */
function opening(makeSource) {
  hook.opened = Promise.resolve().then(makeSource).then(open);
  hook.opened.catch(fail);
}

function fail(error) {
  say(error.message ?? String(error), true);
  part('facts').textContent = '';
  part('controls').disabled = true;
}

function say(message, isError = false) {
  part('message').textContent = message;
  part('message').className = isError ? 'error' : '';
  part('message').hidden = message === '';
}

function describe(name) {
  const { pages, vertexLit, meshes } = viewer;
  const sizes = [...pages.values()].map(({ texture }) => `${texture.image.width} × ${texture.image.height}`);
  const kinds = [...new Set(sizes)].map((size) => `${sizes.filter((other) => other === size).length} of ${size} texels`);
  const lightmap = `lightmap pages: ${kinds.join(', ')}`;
  const bake = sizes.length > 0 ? lightmap : vertexLit > 0 ? 'light at the vertices' : 'no baked light';
  part('facts').textContent = `${name}\n${meshes.length} meshes\n${bake}`;
}

/** Puts the settings of the viewer on the page. */
function show() {
  const { split, other, stops } = viewer.settings;
  part('exposure').value = stops;
  part('stops').textContent = `${stops < 0 ? '−' : '+'}${Math.abs(stops).toFixed(1)} stops`;
  part('split').value = split;
  part('divider').style.left = `${split * 100}%`;
  part('right').textContent = LABELS[other];
  part('note').textContent = NOTES[other];
  part('other').value = other;
  part('divider').hidden = false;
  part('left').hidden = split < 0.1;
  part('right').hidden = split > 0.9;
  viewer.changed();
}

function set(changes) {
  Object.assign(viewer.settings, changes);
  show();
}

function connect() {
  part('camera').onchange = (event) => viewer.look(Number(event.target.value));
  part('exposure').oninput = (event) => set({ stops: Number(event.target.value) });
  part('curve').onchange = (event) => set({ curve: event.target.checked });
  part('split').oninput = (event) => set({ split: Number(event.target.value) });
  part('other').onchange = (event) => set({ other: event.target.value, split: Math.min(viewer.settings.split, 0.5) });
  part('divider').onpointerdown = (event) => event.target.setPointerCapture(event.pointerId);
  part('divider').onpointermove = (event) => {
    if (!event.target.hasPointerCapture(event.pointerId)) return;
    const { left, width } = part('view').getBoundingClientRect();
    set({ split: Math.min(Math.max((event.clientX - left) / width, 0), 1) });
  };
  for (const [button, input] of [['open-folder', 'folder'], ['open-files', 'files']]) {
    part(button).onclick = () => part(input).click();
    part(input).onchange = ({ target }) => {
      const files = picked(target);
      target.value = ''; // so that the same files, baked again, count as a change
      opening(() => fromFiles(files));
    };
  }
  document.body.ondragover = (event) => event.preventDefault();
  document.body.ondrop = (event) => {
    event.preventDefault();
    const files = dropped(event.dataTransfer);
    opening(async () => fromFiles(await files));
  };
}

/** Bytes as base64: what a check outside the browser can take. */
function base64(array) {
  const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
  let text = '';
  for (let at = 0; at < bytes.length; at += 32768) text += String.fromCharCode(...bytes.subarray(at, at + 32768));
  return btoa(text);
}

/** Lightmap pages as three.js holds them: halves R, G, B, A, bottom row first. */
function pages() {
  return [...viewer.pages.values()].map(({ texture }) => {
    const { width, height, data } = texture.image;
    return { uri: texture.name, width, height, halves: base64(data) };
  });
}

if (viewer) {
  connect();
  if (query.has('file')) opening(() => fromAddress(query.get('file')));
}
window.texelwalk = hook;
