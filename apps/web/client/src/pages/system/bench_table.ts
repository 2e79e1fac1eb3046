// The lines of a bench as a table. Pure.
import type { Json } from '../../api';
import { capital, withUnit } from '../../format';

export type BenchRow = Record<string, string | number | boolean | null>;

// The objects among the lines; what is nested becomes "outer inner", numbers get at most four digits.
export function benchRows(lines: readonly Json[]): BenchRow[] {
  const rows: BenchRow[] = [];
  for (const line of lines) {
    if (line === null || typeof line !== 'object' || Array.isArray(line)) continue;
    const row: BenchRow = {};
    const add = (object: { [name: string]: Json }, prefix: string) => {
      for (const [name, value] of Object.entries(object)) {
        const key = prefix + name;
        if (typeof value === 'number')
          row[key] = Number.isInteger(value) ? value : Number(value.toPrecision(4));
        else if (value === null || typeof value !== 'object') row[key] = value;
        else if (Array.isArray(value)) row[key] = value.map((one) => String(one)).join(', ');
        else add(value, `${key} `);
      }
    };
    add(line, '');
    if (Object.keys(row).length > 0) rows.push(row);
  }
  return rows;
}

// All names in the order in which they come, but for the bench's own; those that have no value in any row left out.
export function benchColumns(rows: readonly BenchRow[]): { name: string; label: string; number: boolean }[] {
  const names = [...new Set(rows.flatMap((row) => Object.keys(row)))];
  return names
    .filter(
      (name) =>
        name !== 'bench' &&
        rows.some((row) => row[name] !== undefined && row[name] !== null && row[name] !== ''),
    )
    .map((name) => {
      return {
        name,
        label: capital(withUnit(name)),
        number: rows.every(
          (row) => row[name] === undefined || row[name] === null || typeof row[name] === 'number',
        ),
      };
    });
}
