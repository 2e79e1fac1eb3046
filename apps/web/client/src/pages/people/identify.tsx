// Who is in an image.
import { useEffect, useState } from 'preact/hooks';
import { api, call, type Json } from '../../api';
import { Button, FileDrop, Notice, Table } from '../../ui';
import { attempt } from '../../ui/toast';
import { addressOf } from '../shared/files';
import { drawnPeople } from './drawn';
import { identifiedFacesOf, type IdentifiedFace, type Person } from './model';

interface Answer {
  image: string; // address
  name: string;
  faces: IdentifiedFace[];
}

export function Identify({ people }: { people: Person[] }) {
  const [answer, setAnswer] = useState<Answer | null>(null);
  const [busy, setBusy] = useState(false);
  const [next, setNext] = useState(0);
  useEffect(
    () => () => {
      if (answer?.image.startsWith('blob:')) URL.revokeObjectURL(answer.image);
    },
    [answer],
  );
  const ask = async (run: () => Promise<Answer>) => {
    setBusy(true);
    const found = await attempt(run);
    if (found) setAnswer(found);
    setBusy(false);
  };
  const photo = (file: File) =>
    ask(async () => {
      const response = await call('/api/v1/people/identify', {
        method: 'POST',
        body: file,
        type: file.type || 'image/jpeg',
      });
      const line = (await response.json()) as Json;
      return { image: URL.createObjectURL(file), name: file.name, faces: identifiedFacesOf(line) };
    });
  const drawn = () =>
    ask(async () => {
      const two = await drawnPeople();
      const file = two.others[next % two.others.length]!;
      setNext(next + 1);
      const reference = `job:${two.job}/${file}`;
      const run = await api.run('people identify', [reference]);
      const line = run.lines[0];
      if (line === undefined) throw new Error(run.error || 'The program returned no result.');
      return {
        image: addressOf(reference) ?? '',
        name: file.split('/').pop() ?? file,
        faces: identifiedFacesOf(line),
      };
    });
  return (
    <div class="stack">
      {people.length === 0 && <Notice>Nobody is enrolled yet: every face will be unknown.</Notice>}
      <FileDrop
        label="An image"
        help="The image is analysed and not stored."
        accept="image/*"
        disabled={busy}
        onFiles={(files) => void photo(files[0]!)}
      />
      <div class="row">
        <Button busy={busy} onClick={() => void drawn()}>
          Try with synthetic data
        </Button>
      </div>
      {answer && <Faces answer={answer} />}
    </div>
  );
}

function Faces({ answer }: { answer: Answer }) {
  const [size, setSize] = useState<{ w: number; h: number } | null>(null);
  const { faces } = answer;
  const said = (one: IdentifiedFace) => (one.known && one.label !== null ? one.label : 'unknown');
  return (
    <section class="stack" aria-live="polite" aria-label="Result">
      <h2>
        {faces.length === 0
          ? 'No face was found'
          : `${faces.length} ${faces.length === 1 ? 'face' : 'faces'}: ${faces.map(said).join(', ')}`}
      </h2>
      <div class="boxed">
        <img
          src={answer.image}
          alt={`The image ${answer.name}`}
          onLoad={(event) =>
            setSize({ w: event.currentTarget.naturalWidth, h: event.currentTarget.naturalHeight })
          }
        />
        {size && (
          <svg viewBox={`0 0 ${size.w} ${size.h}`} aria-hidden="true">
            {faces.map((one, i) => (
              <g key={i} class={one.known ? 'box-known' : 'box-unknown'}>
                <rect x={one.box[0]} y={one.box[1]} width={one.box[2]} height={one.box[3]} />
                <text
                  x={one.box[0]}
                  y={Math.max(size.h / 24, one.box[1] - size.h / 80)}
                  font-size={size.h / 20}
                >
                  {said(one)}
                </text>
              </g>
            ))}
          </svg>
        )}
      </div>
      <Table
        caption="Faces"
        columns={[
          { name: 'Person', show: said },
          { name: 'Confidence', show: (one) => `${(100 * one.confidence).toFixed(0)} %`, number: true },
          { name: 'Nearest', show: (one) => one.label ?? '' },
          { name: 'Box, px', show: (one) => one.box.join(', '), number: true },
        ]}
        rows={faces}
        keyOf={(_, i) => i}
      />
    </section>
  );
}
