declare module 'virtual:docs' {
  export const pages: { name: string; title: string; html: string }[];
}

declare module 'virtual:api' {
  const api: import('./routes').Api;
  export default api;
}
