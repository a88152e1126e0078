import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";

// `npm run dev` shows the page of a checkout against a gateway that runs already.
const gateway = process.env.DISTALOCK_CONSOLE_GATEWAY ?? "http://127.0.0.1:8000";

export default defineConfig({
  plugins: [react()],
  build: {
    target: "es2022",
    // The content security policy allows no inline code, and `data:` nowhere.
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    // three.js is in the file of the thread that draws the scene; it is loaded after the page is there.
    chunkSizeWarningLimit: 1200,
  },
  server: {
    proxy: Object.fromEntries(
      ["/api", "/readyz", "/healthz", "/virtual-room"].map((path) => [path, { target: gateway, ws: true }]),
    ),
  },
  test: {
    // Tests of components say `@vitest-environment jsdom`; it takes longer to make than they to run.
    environment: "node",
    include: ["src/**/*.test.{ts,tsx}"],
    pool: "threads",
    // No test changes what another sees, so that all share one worker and what it has loaded.
    isolate: false,
    poolOptions: { threads: { singleThread: true } },
  },
});
