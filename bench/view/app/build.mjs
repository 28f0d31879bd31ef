// Builds ../static/app.js, the one file that the wheel carries; another path as argument goes there instead.
import { build } from "esbuild";

await build({
  entryPoints: [new URL("src/main.jsx", import.meta.url).pathname],
  outfile: process.argv[2] ?? new URL("../static/app.js", import.meta.url).pathname,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  // Names of the machine's folders must not be in it.
  absWorkingDir: new URL(".", import.meta.url).pathname,
  jsx: "automatic",
  jsxImportSource: "preact",
  loader: { ".css": "text" },
  legalComments: "none",
  banner: { js: "// Built by `make view` from bench/view/app; with preact, @mcap/core and fzstd (MIT)." },
});
