// Builds the page into src/solen/studio/page. Run it by `make page`; the output is committed.
import { build } from "esbuild";
import { copyFileSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";

const out = new URL("../src/solen/studio/page/", import.meta.url).pathname;
const common = { bundle: true, minify: true, target: "es2022", legalComments: "none", logLevel: "warning" };

// Each tab is a file of its own, loaded when it is opened; what several need is a chunk.
for (const name of readdirSync(out)) if (name.endsWith(".js")) rmSync(out + name);
await build({ ...common, entryPoints: ["src/studio.ts"], format: "esm", splitting: true, chunkNames: "[name]-[hash]", outdir: out });
await build({ ...common, entryPoints: ["src/studio.css"], outfile: `${out}studio.css` });
for (const name of ["index.html", "icon.svg"]) copyFileSync(`src/${name}`, `${out}${name}`);

// The page without a server holds all of it in one file.
const inside = await build({ ...common, entryPoints: ["src/player.ts"], format: "iife", write: false });
const script = inside.outputFiles[0].text.replaceAll("</script", "<\\/script");
const packages = ["lit", "lit-html", "lit-element", "@lit/reactive-element", "uplot"];
const texts = packages.map((name) => `${name}\n\n${readFileSync(`node_modules/${name}/LICENSE`, "utf8").trim()}\n`);
const page = readFileSync("src/player.html", "utf8")
  .replace("licences", () => texts.join("\n").replaceAll("--", "- -"))
  .replace("/*style*/", () => readFileSync(`${out}studio.css`, "utf8"))
  .replace("/*script*/", () => script);
writeFileSync(new URL("../src/solen/report/design/player.html", import.meta.url), page);

writeFileSync(`${out}licences.txt`, texts.join("\n----\n\n"));
