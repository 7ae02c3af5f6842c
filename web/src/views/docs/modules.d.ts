declare module 'virtual:docs' {
  export const pages: { name: string; title: string; html: string }[];
}

declare module 'js-yaml' {
  export function load(text: string): unknown;
}
