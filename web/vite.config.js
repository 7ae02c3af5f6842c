import { defineConfig } from 'vite';

// `npm run dev` serves the page and passes the API on to a ground station.
const server = process.env.VOLERY_SERVER ?? 'http://127.0.0.1:8080';

export default defineConfig({
  esbuild: { jsx: 'automatic', jsxImportSource: 'preact', legalComments: 'none' },
  build: {
    target: 'es2022',
    // Small pictures inside of scripts would need `data:` in the content policy.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 900,
    rollupOptions: {
      output: {
        manualChunks: (id) => (id.includes('/node_modules/three/') ? 'three' : undefined),
      },
    },
  },
  server: {
    proxy: {
      '/v1': { target: server, ws: true },
      '/openapi.yaml': server,
    },
  },
});
