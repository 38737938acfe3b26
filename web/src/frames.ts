// The form of what the server sends; see solen/studio/frames.py.
export const VERSION = 1;

export interface Columns {
  rows: number;
  columns: number;
  data: Float32Array;
}

export interface Merits {
  [key: string]: number | null;
}

export interface CurveHead {
  name: string;
  rays: number | null;
  in_space: boolean;
  finished: boolean;
  merits: Merits | null;
  ends: (number | null)[];
  u_ends: (number | null)[];
}

// eslint-disable-next-line @typescript-eslint/no-explicit-any
export type Header = Record<string, any> & { kind: string };

export interface Frame {
  head: Header;
  arrays: Record<string, Columns>;
}

export function decoded(buffer: ArrayBuffer): Frame {
  const view = new DataView(buffer);
  if (view.getUint8(0) !== VERSION) throw new Error(`frame of version ${view.getUint8(0)}`);
  const size = view.getUint32(4, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, size))) as Header;
  const arrays: Record<string, Columns> = {};
  let place = 8 + size;
  for (const [name, rows, columns] of head.arrays as [string, number, number][]) {
    arrays[name] = { rows, columns, data: new Float32Array(buffer, place, rows * columns) };
    place += 4 * rows * columns;
  }
  return { head, arrays };
}
