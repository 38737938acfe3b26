// Drives the page as a person would, and prints what was seen as one JSON object. Called by tests/studio/test_page.py.
import { readFileSync } from "node:fs";
import { chromium } from "playwright-core";
import { bench, microscope, print, resin } from "./tabs.mjs";

const [address, folder, program, extent, exported] = process.argv.slice(2);
const whole = extent === "whole"; // with screenshots and times
const axe = readFileSync(new URL("../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");
const browser = await chromium.launch({ executablePath: program, args: ["--no-sandbox"] });
const seen = { problems: [], foreign: [], axe: [] };
const origin = new URL(address).origin;

const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, colorScheme: "light", acceptDownloads: true });
const page = await context.newPage();
page.setDefaultTimeout(300_000); // also where the computer is busy
// a screenshot makes the software driver of WebGL warn of its own slowness
const driver = /GL Driver Message/;
page.on("console", (message) => ["error", "warning"].includes(message.type()) && !driver.test(message.text()) && seen.problems.push(message.text()));
page.on("pageerror", (error) => seen.problems.push(String(error)));
page.on("request", (request) => {
  const { protocol, origin: from } = new URL(request.url());
  if (protocol.startsWith("http") && from !== origin) seen.foreign.push(request.url());
});

const version = () => page.evaluate(() => Number(document.querySelector("solen-studio")?.dataset.version ?? 0));
async function rest(act) {
  const before = await version();
  await act();
  await page.waitForFunction((n) => Number(document.querySelector("solen-studio")?.dataset.rest ?? 0) > n, before);
}
const picture = (name, of = page) => (whole ? of.screenshot({ path: `${folder}/${name}.png` }) : undefined);
const text = (selector) => page.locator(selector).innerText();
const value = (key) => page.locator(`[id="field-${key}"]`).inputValue();
const merit = (id) => text(`#merit-${id} td:nth-child(2)`);
async function audit(name) {
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => axe.run({ resultTypes: ["violations"] }));
  for (const { id, impact, nodes } of violations) seen.axe.push(`${name}: ${id} (${impact}) ${nodes[0].html.slice(0, 120)}`);
}
async function drag(name, dx, dy, steps) {
  const box = await page.locator(`#handle-${name}`).boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let i = 1; i <= steps; i++) await page.mouse.move(x + (dx * i) / steps, y + (dy * i) / steps);
  await page.mouse.up();
}
const times = async () => {
  const all = await page.evaluate(() => performance.getEntriesByType("measure").map((one) => one.duration));
  await page.evaluate(() => performance.clearMeasures());
  return all;
};

await rest(() => page.goto(address));
seen.paint_ms = await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0].startTime);
if (await page.locator(".offered").count()) {
  seen.offered = await text(".offered p");
  await audit("offered");
  await page.getByRole("button", { name: "Leave them there" }).click();
  await page.waitForSelector(".offered", { state: "detached" });
}
seen.offers_left = await page.locator(".offered").count();
if (!(await page.locator(".guide").count())) await page.getByRole("button", { name: "Guide" }).click();
seen.guide = await page.locator(".guide p").allInnerTexts();
await audit("light");
await picture("first");
await page.locator(".guide button").click();
seen.guide_left = await page.locator(".guide").count();

// keyboard alone
await page.locator("#handle-turn").focus();
for (let i = 0; i < 3; i++) await page.keyboard.press("ArrowRight");
await page.waitForFunction(() => document.querySelector(".angle output").textContent.includes("0.30"));
seen.turned = await text(".angle output");
seen.focus_outline = await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle);

// a drag is one step of undo
await drag("emitter", 6, 0, 12);
await page.waitForFunction(() => Number(document.getElementById("field-emitter.offset_mm").value) > 0.01);
seen.offset = await value("emitter.offset_mm");
seen.coordinates = await text(".coordinates");
await page.keyboard.press("Control+z");
await page.waitForFunction(() => Number(document.getElementById("field-emitter.offset_mm").value) === 0);

// a number, and one that cannot be
const focus = page.locator('[id="field-lens.focus_mm"]');
await rest(async () => {
  await focus.fill("25");
  await focus.press("Enter");
});
seen.merits = {};
for (const id of ["from", "to", "slope_per_deg", "null_deg", "span", "linearity_percent", "light"]) seen.merits[id] = await page.locator(`#merit-${id} td`).allInnerTexts();
seen.misleading = (await page.locator(".warning").count()) ? await text(".warning") : "";
seen.quality = await text(".quality");
await page.getByTitle("The same from the command line").click();
seen.unsaved = await page.locator(".same pre").allInnerTexts();
await page.getByTitle("The same from the command line").click();
await focus.fill("-5");
await focus.press("Enter");
await page.waitForSelector(".status.refused");
seen.refused = await text(".status");
seen.focus_shown = await value("lens.focus_mm");
seen.focus_kept = await page.evaluate(() => document.querySelector("solen-studio").values.lens.focus_mm);
await page.keyboard.press("Control+s");
await page.waitForFunction(() => document.querySelector(".status").textContent.includes("Saved"));
seen.saved = await text(".status");

await page.getByTitle("The same from the command line").click();
seen.same = await page.locator(".same pre").allInnerTexts();
await audit("commands");
await page.getByTitle("The same from the command line").click();

// what matters
await page.getByRole("button", { name: "Tolerances" }).click();
await page.waitForFunction((n) => document.querySelectorAll(".matters tbody tr").length >= n, 5);
seen.matters = await page.locator(".matters tbody tr").allInnerTexts();
await picture("matters");
await page.getByRole("button", { name: "Tolerances" }).click();

// a search in the background, whose front grows; one of its designs becomes the open one
await page.getByRole("button", { name: "Make it straighter" }).click();
await page.waitForSelector("textarea[name=free]");
seen.suggested = await page.locator("textarea[name=free]").inputValue();
await page.locator("textarea[name=minimise]").fill("abs(null_deg)");
await page.locator("textarea[name=maximise]").fill("light");
await page.locator("textarea[name=free]").fill("emitter.offset_mm=-0.03:0.03\nlens.focus_mm=20:30");
await page.locator("textarea[name=subject_to]").fill("");
await page.locator("input[name=evaluations]").fill("70");
await page.getByRole("button", { name: "Begin" }).click();
await page.waitForFunction(() => document.querySelectorAll(".designs tbody tr").length >= 1, null);
seen.share = await page.locator(".progress progress").evaluate((one) => one.value);
await page.waitForFunction(() => document.querySelector(".search-panel .quality").textContent.includes("traced again"));
await audit("search");
await picture("search", page.locator(".search-panel"));
await picture("searched");
seen.designs = await page.locator(".designs tbody tr").allInnerTexts();
seen.search = await page.locator(".search-panel pre").innerText();
await page.locator(".designs tbody button").last().click();
await page.waitForFunction(() => Number(document.getElementById("field-lens.focus_mm").value) !== 25);
seen.taken = [await value("lens.focus_mm"), await value("emitter.offset_mm")];
await page.keyboard.press("Control+z");
await page.waitForFunction(() => Number(document.getElementById("field-lens.focus_mm").value) === 25);
await page.getByRole("button", { name: "Make it straighter" }).click();

// the picture as a file
for (const [name, file] of [["SVG", "drawing.svg"], ["Response as SVG", "response.svg"], ["Response as PNG", "response.png"]]) {
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name, exact: true }).click()]);
  await download.saveAs(`${folder}/${file}`);
}

// how long it takes from a request to what is drawn, with 200 rays and a chip's response
for (const light of whole ? ["plane", "space"] : []) {
  await rest(() => page.locator(".answer .choice button", { hasText: light }).click().then(() => page.locator("#handle-emitter").press("ArrowRight")));
  await times();
  await drag("emitter", 12, 0, 60);
  await page.waitForTimeout(300);
  seen[`${light}_ms`] = await times();
}

await resin(page, seen, picture, audit);
await print(page, seen, picture, audit);
await microscope(page, seen, picture, audit);
await bench(page, seen, picture, audit, whole);

await page.emulateMedia({ colorScheme: "dark" });
await audit("dark");
for (const [width, height] of whole ? [[1024, 700], [1440, 900], [2560, 1440]] : [])
  for (const colorScheme of ["light", "dark"]) {
    await page.setViewportSize({ width, height });
    await page.emulateMedia({ colorScheme });
    await page.waitForTimeout(150);
    await picture(`${width}-${colorScheme}`);
  }
await page.setViewportSize({ width: 1024, height: 700 });
seen.overflow = await page.evaluate(() =>
  [...document.querySelectorAll("body, section, .fields, .merits")].filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.className || one.tagName),
);
seen.overlaid = await page.evaluate(() => {
  const box = (selector) => document.querySelector(selector).getBoundingClientRect();
  return box(".answer .tools button:last-child").bottom > box(".plot").top;
});
if (exported) {
  await page.setViewportSize({ width: 1200, height: 800 });
  await page.goto(exported);
  await page.locator('[id="lens.focus_mm"]').focus();
  await page.keyboard.press("ArrowRight");
  await page.locator("#angle").focus();
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => document.querySelector(".angle output").textContent !== "0°");
  seen.player = { angle: await page.locator(".angle output").first().innerText(), from: await merit("from"), to: await merit("to") };
  await audit("player");
  await picture("player");
}
await browser.close();
console.log(JSON.stringify(seen));
