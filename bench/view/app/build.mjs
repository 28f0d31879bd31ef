// Builds ../static/app.js, the one file that the wheel carries; another path as argument goes there instead.
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { build } from "esbuild";

const here = new URL(".", import.meta.url).pathname;
const outfile = process.argv[2] ?? join(here, "../static/app.js");
const { metafile } = await build({
  entryPoints: ["src/main.jsx"],
  outfile,
  metafile: true,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  // Names of the machine's folders must not be in it.
  absWorkingDir: here,
  jsx: "automatic",
  jsxImportSource: "preact",
  loader: { ".css": "text" },
  legalComments: "none",
  banner: { js: "// Built by `make view` from bench/view/app; LICENSES.txt has the terms of its parts." },
});

// The terms of every package of which a file is in the script.
const names = new Set(Object.keys(metafile.inputs).flatMap((path) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1] ?? []));
const terms = [...names].sort().map((name) => {
  const folder = join(here, "node_modules", name);
  const file = readdirSync(folder).find((entry) => /^licen[cs]e/i.test(entry));
  return `${name}\n\n${readFileSync(join(folder, file), "utf8").trim()}\n`;
});
writeFileSync(join(dirname(outfile), "LICENSES.txt"), terms.join("\n----\n\n"));
