// Frames of the page while the lens is turned and the emitter is dragged. Called by tools/studio_film.py.
import { chromium } from "playwright-core";

const [address, folder, program] = process.argv.slice(2);
const browser = await chromium.launch({ executablePath: program, args: ["--no-sandbox"] });
const page = await browser.newPage({ viewport: { width: 1280, height: 800 }, colorScheme: "light" });
await page.goto(address);
const rested = () => page.waitForFunction(() => document.querySelector("solen-studio").dataset.rest === document.querySelector("solen-studio").dataset.version, null, { timeout: 120_000 });
await page.waitForFunction(() => document.querySelector("solen-studio")?.dataset.rest, null, { timeout: 120_000 });
await page.locator(".guide button").last().click();
let number = 0;
const frame = async () => page.screenshot({ path: `${folder}/frame-${String(number++).padStart(3, "0")}.png` });

// Drag a handle along x through shares of a way, a frame at each.
async function drag(name, way, shares) {
  const box = await page.locator(`#handle-${name}`).boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (const share of shares) {
    await page.mouse.move(x + way * share, y);
    await page.waitForTimeout(150);
    await frame();
  }
  await page.mouse.up();
}

const wave = (steps) => Array.from({ length: steps }, (_, i) => Math.sin((2 * Math.PI * (i + 1)) / steps));
await frame();
await drag("turn", 6, wave(28)); // within the motion's three degrees
await drag("emitter", 5, wave(20));
await rested();
await frame();
await browser.close();
