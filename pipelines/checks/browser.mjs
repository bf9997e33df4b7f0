/**
 * Opens pages in headless Chromium with software WebGL, and writes down what their hooks hand over.
 *
 * In, as JSON on stdin: `{ modules, chromium, jobs }`, a job being
 * `{ address, files, width, height, strata, screenshots: [{ path, settings }] }`;
 * `modules` holds playwright-core; `files`, if any, are picked on the page. Out, as JSON on stdout: for every job
 * `{ radiance, quick, pages, vertices }` as the page's `window.texelwalk` gives them (base64; `quick` has one sample a pixel), or
 * `{ error }`, what the page says went wrong. Called by browser_session.py.
 */

import { createRequire } from 'node:module';
import { text } from 'node:stream/consumers';

/** SwiftShader draws the same on every machine. Chromium refuses to run as root with its sandbox. */
const FLAGS = ['--use-angle=swiftshader', '--use-gl=angle', '--enable-unsafe-swiftshader', '--disable-dev-shm-usage'];
const TIMEOUT_MILLISECONDS = 120_000;
/** For screenshots; what is not looked at is drawn small, because SwiftShader takes its time. */
const WINDOW = { width: 1200, height: 700 };
const SMALL = { width: 300, height: 60 };

const { modules, chromium, jobs } = JSON.parse(await text(process.stdin));
const { chromium: driver } = createRequire(`${modules}/`)('playwright-core');

async function run(browser, { address, files = [], width, height, strata, screenshots = [] }) {
  const page = await browser.newPage({ viewport: screenshots.length > 0 ? WINDOW : SMALL });
  page.setDefaultTimeout(TIMEOUT_MILLISECONDS);
  const said = [];
  page.on('console', (message) => { if (message.type() === 'error') said.push(message.text()); });
  page.on('pageerror', (error) => said.push(error.message));
  try {
    await page.goto(address);
    await page.waitForFunction(() => window.texelwalk);
    if (files.length > 0) await page.setInputFiles('#files', files);
    const result = await page.evaluate(async (options) => {
      await window.texelwalk.opened;
      const { radiance, pages, vertices } = window.texelwalk;
      const quick = radiance({ ...options, strata: 1 });
      return { radiance: radiance(options), quick, pages: pages(), vertices: vertices() };
    }, { width, height, strata });
    for (const { path, settings } of screenshots) {
      await page.evaluate((changes) => window.texelwalk.set(changes), settings);
      await page.screenshot({ path });
    }
    return said.length > 0 ? { error: said.join('\n') } : result;
  } catch (error) {
    return { error: [error.message, ...said].join('\n') };
  } finally {
    await page.close();
  }
}

const sandbox = process.getuid?.() !== 0;
const browser = await driver.launch({ executablePath: chromium, args: FLAGS, chromiumSandbox: sandbox });
const results = [];
for (const job of jobs) results.push(await run(browser, job));
await browser.close();
process.stdout.write(JSON.stringify(results));
