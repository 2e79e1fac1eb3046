// Sliders by the word before their number: "shape 1", "shape 2" .. are one group. Pure.
import type { SliderInfo } from '../../api';

export interface SliderGroup {
  name: string; // "shape"; '' for one without a number
  sliders: SliderInfo[];
}

// In the order of their first ones. A slider without a number is a group of its own.
export function groupsOf(sliders: readonly SliderInfo[]): SliderGroup[] {
  const groups: SliderGroup[] = [];
  for (const slider of sliders) {
    const name = /^(.*\D) \d+$/.exec(slider.name)?.[1] ?? '';
    const group = name === '' ? undefined : groups.find((one) => one.name === name);
    if (group) group.sliders.push(slider);
    else groups.push({ name, sliders: [slider] });
  }
  return groups;
}
