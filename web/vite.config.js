import { defineConfig } from 'vite';
import { documents } from './docs-plugin.js';

// `npm run dev` and `npx vite preview` serve the page and pass the API on to a ground station.
const server = process.env.VOLERY_SERVER ?? 'http://127.0.0.1:8080';

const proxy = { '/v1': { target: server, ws: true }, '/openapi.yaml': server };

export default defineConfig({
  plugins: [documents()],
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
  server: { proxy },
  preview: { proxy },
});
