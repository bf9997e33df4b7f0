/**
 * Where a document comes from: an address, or files that were dropped or picked.
 *
 * Out: `{ name, load(loader) }`; `load` takes a function that makes a GLTFLoader for a LoadingManager, and promises the
 * document. References between picked files are resolved by the end of their path, then by their name; one that is not
 * among the files is an error that says so.
 */

import { LoadingManager } from 'three';

/** A document at an address. */
export function fromAddress(address) {
  const name = decodeURIComponent(address.split(/[?#]/)[0].split('/').pop());
  return { name, load: (makeLoader) => makeLoader(new LoadingManager()).loadAsync(address) };
}

/** The first glTF or GLB among files `{ path, file }`. */
export function fromFiles(entries) {
  const document = entries.find(({ path }) => /\.(gltf|glb)$/i.test(path));
  if (!document) throw new Error('there is no .gltf or .glb among these files');
  const folder = document.path.slice(0, document.path.lastIndexOf('/') + 1);
  const load = async (makeLoader) => {
    const made = [];
    const manager = new LoadingManager();
    manager.setURLModifier((address) => {
      if (/^(blob|data):/.test(address)) return address;
      const url = URL.createObjectURL(find(entries, folder, decodeURIComponent(address)).file);
      made.push(url);
      return url;
    });
    try {
      return await makeLoader(manager).parseAsync(await document.file.arrayBuffer(), '');
    } finally {
      made.forEach((url) => URL.revokeObjectURL(url));
    }
  };
  return { name: document.path, load };
}

function find(entries, folder, address) {
  const name = address.split('/').pop();
  const found = entries.find(({ path }) => path === folder + address)
    ?? entries.find(({ path }) => path.split('/').pop() === name);
  if (!found) throw new Error(`${address} is not among these files; open the whole folder, or drop all files together`);
  return found;
}

/** Files of an `<input type="file">`. */
export function picked(input) {
  return [...input.files].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
}

/** Files of a drop, those in folders, too. Entries must be taken before anything is awaited. */
export async function dropped(transfer) {
  const roots = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
  return (await Promise.all(roots.map((entry) => inside(entry, '')))).flat();
}

async function inside(entry, folder) {
  const path = folder + entry.name;
  if (entry.isFile) return [{ path, file: await new Promise((good, bad) => entry.file(good, bad)) }];
  const reader = entry.createReader();
  const all = [];
  for (;;) {
    // A reader hands over at most 100 entries at a time.
    const some = await new Promise((good, bad) => reader.readEntries(good, bad));
    if (some.length === 0) break;
    all.push(...some);
  }
  return (await Promise.all(all.map((child) => inside(child, `${path}/`)))).flat();
}
