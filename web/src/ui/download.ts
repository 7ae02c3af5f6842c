import { request, type Options } from '../api/client';

/** Gives bytes of the API to the browser as a file. */
export async function download(path: string, options: Options, name: string): Promise<void> {
  const response = await request('GET', path, null, options);
  const url = URL.createObjectURL(await response.blob());
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
