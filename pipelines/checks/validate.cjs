// Runs the Khronos glTF validator on files; prints one JSON array of its reports.
//
// In: NODE_MODULES FILE…. External buffers and images are read from beside each file. Called by validate.py.

const fs = require("fs");
const path = require("path");

const [modules, ...files] = process.argv.slice(2);
const validator = require(path.join(modules, "gltf-validator"));

async function report(file) {
  const folder = path.dirname(path.resolve(file));
  return validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
    uri: path.basename(file),
    maxIssues: 0, // all of them
    externalResourceFunction: async (uri) =>
      new Uint8Array(fs.readFileSync(path.join(folder, decodeURIComponent(uri)))),
  });
}

(async () => {
  const reports = [];
  for (const file of files) reports.push(await report(file));
  process.stdout.write(JSON.stringify(reports));
})().catch((error) => {
  process.stderr.write(`error: ${error && error.message ? error.message : error}\n`);
  process.exit(1);
});
