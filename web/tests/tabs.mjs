// Uses the tabs beside the design as a person would; each writes what it saw into `seen`.
const at = (path) => new URL(`../../${path}`, import.meta.url).pathname;

// By keys to the tab; a dropped table, what is missing, the numbers, a saved resin.
export async function resin(page, seen, picture, audit) {
  const panel = page.locator("#panel-resin");
  await page.locator("#tab-design").focus();
  await page.keyboard.press("ArrowRight");
  await panel.locator("form").waitFor();
  seen.tabs = await page.getByRole("tab", { selected: true }).allInnerTexts();
  await panel.locator("input[type=file]").setInputFiles(at("src/solen/examples/discs-simulated.csv"));
  await panel.locator(".answer .warning").waitFor();
  seen.lacking = await panel.locator(".answer .warning").innerText();
  await panel.locator('[id="field-resin-cure.irradiance_mW_per_cm2"]').fill("13");
  await panel.locator("form button[type=submit]").click();
  await panel.locator(".values").waitFor();
  seen.resin = await shown(panel);
  await audit("resin");
  await picture("resin");
  await panel.getByRole("button", { name: "Save as a resin" }).click();
  await panel.locator('[id="field-resin-build.name"]').fill("mine");
  await panel.locator("form button[type=submit]").click();
  await panel.getByRole("button", { name: "Use in this design" }).click();
  await page.waitForSelector(".status.refused");
  seen.resin.unusable = await page.locator(".status").innerText();
  await page.locator("#tab-design").click();
}

// The part in space, its layers by a slider.
export async function print(page, seen, picture, audit) {
  const panel = page.locator("#panel-print");
  await page.locator("#tab-print").click();
  await panel.locator("form").waitFor();
  await panel.getByRole("button", { name: "Begin" }).click();
  await panel.locator("canvas.part[data-triangles]").waitFor();
  await panel.locator("canvas.part").press("ArrowRight");
  seen.part = { ...(await shown(panel)), triangles: await panel.locator("canvas.part").getAttribute("data-triangles") };
  await audit("part");
  await picture("part");
  await panel.locator(".command select").selectOption("print layers");
  await panel.locator('[id="field-print-layers.layer_um"]').fill("200");
  await panel.locator("form button[type=submit]").click();
  await panel.locator("canvas.layer[data-layer]").waitFor();
  await panel.locator("#layer").press("Home");
  await panel.locator('canvas.layer[data-layer="1"]').waitFor();
  seen.layers = { ...(await shown(panel)), exposed: await panel.locator(".exposed").innerText(), of: await panel.locator(".angle output").innerText() };
  await panel.locator("#layer").press("ArrowRight");
  await panel.locator('canvas.layer[data-layer="2"]').waitFor();
  await audit("layers");
  await picture("layers");
  await page.locator("#tab-design").click();
}

// Two marks by mouse and keys, a lens between them, and that lens in the design.
export async function microscope(page, seen, picture, audit) {
  const panel = page.locator("#panel-microscope");
  await page.locator("#tab-microscope").click();
  await panel.locator("form").waitFor();
  await panel.locator('[id="field-print-inspect.um_per_px"]').fill("7"); // begins with it, and again with the marks
  await panel.locator('[id="field-print-inspect.um_per_px"]').press("Tab");
  await panel.locator("input[type=file]").setInputFiles(at("src/solen/examples/lens-simulated.ome.tif"));
  await panel.locator(".values").waitFor({ timeout: 60_000 });
  await panel.locator('[id="field-print-inspect.um_per_px"]').fill("");
  await panel.locator('[id="field-print-inspect.um_per_px"]').press("Tab");
  await panel.getByRole("button", { name: "image", exact: true }).click();
  await page.waitForFunction(() => document.querySelector(".framed img").naturalWidth > 0, null, { timeout: 60_000 });
  const box = await panel.locator(".framed img").boundingBox();
  for (const share of [0.1, 0.8]) await page.mouse.click(box.x + share * box.width, box.y + 0.9 * box.height);
  await panel.locator("#mark-1").focus();
  await page.keyboard.press("Shift+ArrowRight");
  await panel.locator("input[name=bar]").fill("3100");
  await panel.locator("input[name=bar]").press("Tab");
  seen.bar = (await panel.locator('[id="field-print-inspect.bar"]').inputValue()).split(", ").map(Number);
  await audit("marks");
  await picture("marks");
  await panel.locator("form button[type=submit]").click();
  await page.waitForFunction(() => [...document.querySelectorAll("#panel-microscope .jobs .unit")].map((one) => one.textContent).join().match(/done/g)?.length === 2, null, { timeout: 60_000 });
  await panel.locator(".values").waitFor();
  seen.microscope = await shown(panel);
  await picture("microscope");
  await panel.getByRole("button", { name: "Use as the lens" }).click();
  await page.waitForFunction(() => document.querySelector("solen-studio").values.lens.shape === "measured");
  seen.lens = await page.evaluate(() => document.querySelector("solen-studio").values.lens.profile);
  await page.locator("#tab-design").click();
  await page.keyboard.press("Control+z");
  await page.waitForFunction(() => document.querySelector("solen-studio").values.lens.shape !== "measured");
}

// A recording; with `live` a simulated rig too, as it runs.
export async function bench(page, seen, picture, audit, live) {
  const panel = page.locator("#panel-bench");
  await page.locator("#tab-bench").click();
  await panel.locator("form").waitFor();
  await panel.locator("input[type=file]").setInputFiles(at("src/solen/examples/rotation-simulated.csv"));
  await panel.locator("img.figure").waitFor({ timeout: 60_000 });
  await panel.locator(".values").waitFor();
  seen.bench = await shown(panel);
  await audit("bench");
  await picture("bench");
  if (live) {
    await panel.locator(".command select").selectOption("bench new");
    await panel.locator("form button[type=submit]").click();
    await panel.getByRole("button", { name: "Run the rotation" }).click({ timeout: 60_000 });
    await panel.locator(".live canvas").waitFor({ timeout: 60_000 });
    await picture("run");
    await panel.getByRole("button", { name: "Calibrate" }).waitFor({ timeout: 120_000 });
    await audit("run");
  }
  await page.locator("#tab-design").click();
}

// What a tab shows of a result: lines, rows by name, the figure, and the same elsewhere.
async function shown(panel) {
  await panel.locator(".values").waitFor();
  await panel.locator("details.same").evaluate((one) => (one.open = true));
  return {
    lines: await panel.locator(".lines p").allInnerTexts(),
    rows: await panel.locator(".values tbody tr").evaluateAll((all) => all.map((one) => [one.dataset.name, one.cells[1].title])),
    same: await panel.locator(".same pre").allInnerTexts(),
    figure: (await panel.locator("img.figure").count()) ? await panel.locator("img.figure").evaluate((one) => one.decode().then(() => one.naturalWidth)) : 0,
  };
}
