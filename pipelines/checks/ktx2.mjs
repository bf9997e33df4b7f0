/*
 * Takes KTX2 files apart with ktx-parse, for formats.py; prints one JSON array.
 *
 * In: NODE_MODULES FILE…. Out per file: format, size, metadata, data format descriptor, and the levels as base64, the
 * largest first. A file that ktx-parse refuses ends the program with its message and exit code 1.
 */

import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [modules, ...files] = process.argv.slice(2);
const { read } = await import(pathToFileURL(path.join(modules, "ktx-parse", "dist", "index.mjs")));

function takenApart(file) {
  const texture = read(new Uint8Array(fs.readFileSync(file)));
  const [block] = texture.dataFormatDescriptor;
  return {
    vkFormat: texture.vkFormat,
    typeSize: texture.typeSize,
    size: [texture.pixelWidth, texture.pixelHeight, texture.pixelDepth],
    layers: texture.layerCount,
    faces: texture.faceCount,
    supercompression: texture.supercompressionScheme,
    keys: Object.fromEntries(Object.entries(texture.keyValue).map(([key, value]) => [key, String(value)])),
    descriptor: {
      vendor: block.vendorId,
      model: block.colorModel,
      primaries: block.colorPrimaries,
      transfer: block.transferFunction,
      flags: block.flags,
      block: [...block.texelBlockDimension],
      bytes: block.bytesPlane[0],
      samples: block.samples.map((s) => [s.bitOffset, s.bitLength, s.channelType, s.sampleLower, s.sampleUpper]),
    },
    levels: texture.levels.map((level) => Buffer.from(level.levelData).toString("base64")),
  };
}

try {
  process.stdout.write(JSON.stringify(files.map(takenApart)));
} catch (error) {
  process.stderr.write(`error: ${error && error.message ? error.message : error}\n`);
  process.exit(1);
}
