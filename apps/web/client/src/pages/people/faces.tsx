// The faces of one person, or of one group of unknown faces: which of them belong elsewhere is said here.
import { useEffect, useState } from 'preact/hooks';
import { api, type Flags } from '../../api';
import { timeText } from '../../format';
import { useLoad } from '../../hooks';
import { AsyncButton, Dialog, Notice, Progress, Select, TextField } from '../../ui';
import { attempt, toast } from '../../ui/toast';
import { blobOfRun } from '../shared/files';
import { correct } from './correct';
import { drawnFaceOf, nameProblem, type DrawnFace } from './model';

export type FaceOwner = { person: string } | { group: number };

const newName = ''; // of the selection of names: somebody who is not enrolled

interface Sheet {
  address: string; // of the one image that has all the faces
  faces: DrawnFace[];
}

async function sheetOf(whose: FaceOwner): Promise<Sheet> {
  const draw = { '--draw': 'out:faces.png' };
  const answer = await ('person' in whose
    ? api.run('people list', [], { '--faces': whose.person, ...draw })
    : api.run('people groups', [], { '--group': whose.group, ...draw }));
  if (answer.exit !== 0) throw new Error(answer.error || 'There are no faces.');
  const faces = answer.lines.map(drawnFaceOf).filter((one): one is DrawnFace => one !== null);
  const image = blobOfRun(answer, 'faces.png');
  return { address: image ? URL.createObjectURL(image) : '', faces };
}

export function FacesDialog(props: {
  whose: FaceOwner;
  names: readonly string[]; // of all who are enrolled
  onChange: () => void;
  onClose: () => void;
}) {
  const { whose } = props;
  const title = 'person' in whose ? `Faces of ${whose.person}` : `Faces of group ${whose.group}`;
  const [chosen, setChosen] = useState<ReadonlySet<number>>(new Set());
  const sheet = useLoad(() => sheetOf(whose), [title]);
  const address = sheet.value?.address ?? '';
  useEffect(() => () => URL.revokeObjectURL(address), [address]);
  const faces = sheet.value?.faces ?? [];
  const ids = faces.map((one) => one.id).filter((id) => chosen.has(id));
  // Each correction closes the dialog where nothing is left to choose from.
  const change = async (run: () => Promise<void>, said: string, isOver: boolean) => {
    await attempt(async () => {
      await run();
      toast(said, 'good');
      setChosen(new Set());
      props.onChange();
      if (isOver) props.onClose();
      else sheet.again();
    });
  };
  const toggle = (id: number) => {
    const next = new Set(chosen);
    if (!next.delete(id)) next.add(id);
    setChosen(next);
  };
  return (
    <Dialog title={title} open onClose={props.onClose} wide>
      <div class="stack">
        {sheet.error && <Notice kind="problem">{sheet.error}</Notice>}
        {!sheet.value && !sheet.error && <Progress label="Loading the faces" done={0} total={0} />}
        {faces.length > 0 && (
          <fieldset class="slider-group">
            <legend>Select the faces that belong to somebody else</legend>
            <ul class="face-choices">
              {faces.map((one) => (
                <li key={one.id}>
                  <FaceChoice
                    face={one}
                    address={address}
                    checked={chosen.has(one.id)}
                    onToggle={() => toggle(one.id)}
                  />
                </li>
              ))}
            </ul>
          </fieldset>
        )}
        <p class="numbers" aria-live="polite">
          {ids.length} of {faces.length} faces are selected.
        </p>
        {'person' in whose ? (
          <OfPerson person={whose.person} names={props.names} ids={ids} all={faces.length} change={change} />
        ) : (
          <div class="row">
            <AsyncButton
              kind="main"
              disabled={ids.length === 0 || ids.length === faces.length}
              run={() =>
                change(
                  () => correct('people correct split', [], { '--group': whose.group, '--sighting': ids }),
                  `${facesText(ids.length)} of group ${whose.group} became a new group.`,
                  false,
                )
              }
            >
              Make a new group of them
            </AsyncButton>
          </div>
        )}
        <p class="field-help">You can undo each correction under “Corrections”.</p>
      </div>
    </Dialog>
  );
}

const facesText = (count: number) => `${count} ${count === 1 ? 'face' : 'faces'}`;

function FaceChoice(props: { face: DrawnFace; address: string; checked: boolean; onToggle: () => void }) {
  const { face, address } = props;
  return (
    <label class="face-choice" title={`${timeText(face.time)}, ${face.source}`}>
      {face.box && (
        <svg viewBox={face.box.join(' ')} aria-hidden="true">
          <image href={address} />
        </svg>
      )}
      <span>
        <input
          type="checkbox"
          aria-label={`Face ${face.id}, quality ${face.quality.toFixed(2)}`}
          checked={props.checked}
          onChange={props.onToggle}
        />{' '}
        {face.id}
      </span>
    </label>
  );
}

// What can be said of faces of a person, and of all of them.
function OfPerson(props: {
  person: string;
  names: readonly string[];
  ids: number[];
  all: number;
  change: (run: () => Promise<void>, said: string, isOver: boolean) => Promise<void>;
}) {
  const { person, ids } = props;
  const others = props.names.filter((one) => one !== person);
  const [to, setTo] = useState(newName);
  const [name, setName] = useState('');
  const [whole, setWhole] = useState('');
  const target = to === newName ? name.trim() : to;
  const isEnrolled = to === newName && props.names.includes(target);
  const problem = isEnrolled ? 'This name is already enrolled: choose it from the list.' : nameProblem(name);
  const into = others.includes(whole) ? whole : (others[0] ?? '');
  const none = ids.length === 0;
  const flags: Flags = { '--face': ids };
  return (
    <>
      <div class="row row-fields">
        <Select
          label="Move them to"
          value={to}
          options={[
            ...others.map((one) => ({ value: one, label: one })),
            { value: newName, label: 'a new person' },
          ]}
          onChange={setTo}
        />
        {to === newName && <TextField label="Name" value={name} onInput={setName} problem={problem} />}
        <AsyncButton
          kind="main"
          disabled={none || target === '' || (to === newName && problem !== '')}
          run={() =>
            props.change(
              () =>
                to === newName
                  ? correct('people correct split', [person, target], flags)
                  : correct('people correct move', [target], flags),
              `${facesText(ids.length)} moved from ${person} to ${target}.`,
              ids.length === props.all,
            )
          }
        >
          Move
        </AsyncButton>
      </div>
      <div class="row">
        <AsyncButton
          disabled={none}
          run={() =>
            props.change(
              async () => {
                for (const id of ids) await correct('people correct not', [], { '--face': id });
              },
              `${facesText(ids.length)}: not ${person}.`,
              ids.length === props.all,
            )
          }
        >
          Not {person}: use them as counterexamples
        </AsyncButton>
      </div>
      {others.length > 0 && (
        <>
          <hr />
          <div class="row row-fields">
            <Select
              label={`${person} is the same person as`}
              value={into}
              options={others.map((one) => ({ value: one, label: one }))}
              onChange={setWhole}
              help="All faces move to that person. This name is removed."
            />
            <AsyncButton
              run={() =>
                props.change(
                  () => correct('people correct merge', [person, into]),
                  `${person} was merged into ${into}.`,
                  true,
                )
              }
            >
              Merge
            </AsyncButton>
          </div>
        </>
      )}
    </>
  );
}
