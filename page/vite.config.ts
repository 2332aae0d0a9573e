import react from "@vitejs/plugin-react";
import { defineConfig } from "vite";

const STUDIO = "http://127.0.0.1:8765";

export default defineConfig({
  plugins: [react()],
  // Relative, so that the page works behind a proxy with a path of its own.
  base: "./",
  build: {
    // The server reads the page from the Python package, so that users need no Node.
    outDir: "../src/photonbeams/studio/page",
    emptyOutDir: true,
    target: "es2022",
    // Inlined assets would be data: addresses, which the server's content security policy allows for pictures alone.
    assetsInlineLimit: 0,
    // What is bundled keeps its licences beside it.
    license: { fileName: "licences.md" },
    chunkSizeWarningLimit: 600,
    modulePreload: { polyfill: false },
  },
  server: {
    // `npm run dev` beside a studio that listens on port 8765.
    proxy: { "/session": { target: "ws://127.0.0.1:8765", ws: true }, "/result": STUDIO, "/presets": STUDIO },
  },
});
