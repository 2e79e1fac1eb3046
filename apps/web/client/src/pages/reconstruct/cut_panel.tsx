// The controls of the cut box: two handles and two numbers for each axis.
import { Button, Checkbox } from '../../ui';
import { axes, moveFace, nameOfFace, stepOf, type Box, type Face } from './cut_box';

const faces = [
  { face: 'low', word: 'from' },
  { face: 'high', word: 'to' },
] as const;

export function CutPanel(props: {
  box: Box;
  whole: Box;
  inside: number;
  count: number;
  only: boolean;
  chosen: Face | null; // that keys of the image move, and that was dragged last
  unit: string | null; // of the scale, if there is one
  scale: number;
  onBox: (box: Box) => void;
  onOnly: (only: boolean) => void;
  onReset: () => void;
  onSave: () => void;
}) {
  const { box, whole, scale } = props;
  const unit = props.unit ?? 'units of the model';
  const digits = (step: number) => Math.max(0, Math.min(6, Math.ceil(-Math.log10(step * scale))));
  const { chosen } = props;
  const chosenText = () => {
    if (!chosen) return '';
    const length = whole.high[chosen.axis]! - whole.low[chosen.axis]!;
    const value = box[chosen.face][chosen.axis]! * scale;
    const word = faces.find((one) => one.face === chosen.face)!.word;
    return `${axes[chosen.axis]!.name} ${word}: ${value.toFixed(digits(stepOf(length)))} ${unit}`;
  };
  return (
    <div class="stack cut-box">
      <p class="field-help">
        Drag the squares in the image. With the keyboard: x, y or z selects a face (press it again for the
        opposite face), point and comma move it, with Shift by ten steps, Escape deselects it.
      </p>
      <p class="numbers" aria-live="polite" data-chosen={chosen ? nameOfFace(chosen) : ''}>
        {chosenText()}
      </p>
      {axes.map(({ name, words }, axis) => {
        const low = whole.low[axis]!;
        const high = whole.high[axis]!;
        const step = stepOf(high - low);
        return (
          <fieldset key={name} class="slider-group">
            <legend>
              {name}, {words}
            </legend>
            {faces.map(({ face, word }) => {
              const value = box[face][axis]!;
              const label = `${name} ${word}, ${unit}`;
              const take = (text: string, by: number) => {
                const next = Number(text) / by;
                if (text.trim() !== '') props.onBox(moveFace(box, whole, axis, face, next));
              };
              return (
                <div key={face} class="cut-face">
                  <span aria-hidden="true">{word}</span>
                  <input
                    type="range"
                    aria-label={label}
                    min={low}
                    max={high}
                    step={step / 10}
                    value={value}
                    aria-valuetext={(value * scale).toFixed(digits(step))}
                    data-face={`${name}-${face}`}
                    onInput={(event) => take(event.currentTarget.value, 1)}
                  />
                  <input
                    type="number"
                    aria-label={`${label}, as a number`}
                    step={Number((step * scale).toPrecision(1))}
                    value={(value * scale).toFixed(digits(step))}
                    data-number={`${name}-${face}`}
                    onChange={(event) => take(event.currentTarget.value, scale)}
                  />
                </div>
              );
            })}
          </fieldset>
        );
      })}
      <p class="numbers" aria-live="polite" data-inside={props.inside}>
        {props.inside} of {props.count} points are in the box.
      </p>
      <Checkbox label="Show only the points in the box" checked={props.only} onChange={props.onOnly} />
      <div class="row">
        <Button disabled={props.inside === 0} onClick={props.onSave}>
          Download the points in the box (PLY)
        </Button>
        <Button onClick={props.onReset}>Reset the box</Button>
      </div>
    </div>
  );
}
