// Numbers and times as people read them.

const counts = new Intl.NumberFormat('en-US');
const times = new Intl.DateTimeFormat(undefined, { dateStyle: 'medium', timeStyle: 'short' });

export const count = (value: number): string => counts.format(value);

export const when = (rfc3339: string): string => times.format(new Date(rfc3339));

export function bytes(value: number): string {
  const units = ['B', 'kB', 'MB', 'GB'];
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    unit++;
  }
  return `${value >= 100 || unit === 0 ? value.toFixed(0) : value.toFixed(1)} ${units[unit]}`;
}

/** `75` s is `1 min 15 s`. */
export function duration(seconds: number): string {
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  const minutes = Math.floor(whole / 60);
  if (minutes < 60) return `${minutes} min ${whole % 60} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** Lengths of a map without a scale are in a unit of its own. */
export function length(value: number, metric: boolean): string {
  if (!metric) return `${value.toFixed(3)} units`;
  return Math.abs(value) < 1 ? `${(value * 100).toFixed(1)} cm` : `${value.toFixed(3)} m`;
}

export const plural = (n: number, one: string, many = `${one}s`): string =>
  `${count(n)} ${n === 1 ? one : many}`;

/** `no_overlap` as words. */
export const words = (name: string): string => name.replaceAll('_', ' ');
