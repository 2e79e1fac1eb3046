// Unknown faces in groups, and what was corrected: named, merged, taken back.
import { useEffect, useState } from 'preact/hooks';
import { api, type Flags } from '../../api';
import { useLoad } from '../../hooks';
import { AsyncButton, Button, Confirm, Dialog, Timestamp, Select, Table, TextField } from '../../ui';
import { attempt, toast } from '../../ui/toast';
import { blobOfRun, hasState } from '../shared/files';
import { correct } from './correct';
import { FacesDialog } from './faces';
import { correctionOf, correctionText, groupOf, nameProblem, type Correction, type Group } from './model';

// The best faces of each group as one image.
async function sheet(): Promise<Blob> {
  const answer = await api.run('people groups', [], { '--draw': 'out:groups.png' });
  const image = blobOfRun(answer, 'groups.png');
  if (!image) throw new Error(answer.error || 'There are no faces.');
  return image;
}

export function Groups(props: { changes: number; onChange: () => void }) {
  const [image, setImage] = useState('');
  const [naming, setNaming] = useState<Group | null>(null);
  const [forgetting, setForgetting] = useState<Group | null>(null);
  const [looking, setLooking] = useState<Group | null>(null);
  const groups = useLoad(async () => {
    if (!(await hasState('gallery'))) return [];
    const answer = await api.run('people groups');
    return answer.lines.map(groupOf).filter((one): one is Group => one !== null);
  }, [props.changes]);
  const rows = groups.value ?? [];
  useEffect(
    () => () => {
      if (image !== '') URL.revokeObjectURL(image);
    },
    [image],
  );
  const change = async (run: () => Promise<void>, said: string) => {
    await attempt(async () => {
      await run();
      setImage('');
      toast(said, 'good');
      props.onChange();
    });
  };
  return (
    <section class="stack" aria-labelledby="groups">
      <h2 id="groups">Unknown faces</h2>
      <p class="field-help">
        Faces of sightings that match no enrolled person. Each group is one person. Name a group to enrol its
        best faces. Ask that person first.
      </p>
      <div class="row">
        <AsyncButton
          run={() =>
            change(async () => {
              const answer = await api.run('people group');
              if (answer.exit > 1) throw new Error(answer.error);
            }, 'The unknown faces were grouped.')
          }
        >
          Group unknown faces
        </AsyncButton>
        <AsyncButton
          disabled={rows.length === 0}
          run={async () => {
            const blob = await attempt(sheet);
            if (blob) setImage(URL.createObjectURL(blob));
          }}
        >
          Show faces
        </AsyncButton>
      </div>
      {image !== '' && (
        <img
          class="sheet"
          src={image}
          alt="The best faces of each group, one row per group, with its number"
        />
      )}
      <Table
        caption="Groups of unknown faces"
        hideCaption
        columns={[
          { name: 'Group', show: (one) => one.group, number: true },
          {
            name: 'Sightings',
            show: (one) => (one.sightings === 1 ? 'once' : `${one.sightings} times`),
            number: true,
          },
          { name: 'Last seen', show: (one) => <Timestamp at={one.last} /> },
          {
            name: 'Actions',
            show: (one) => (
              <div class="row">
                <Button small aria-label={`Name group ${one.group}`} onClick={() => setNaming(one)}>
                  Name
                </Button>
                <Button small aria-label={`Faces of group ${one.group}`} onClick={() => setLooking(one)}>
                  Faces
                </Button>
                <Button
                  small
                  kind="danger"
                  aria-label={`Forget group ${one.group}`}
                  onClick={() => setForgetting(one)}
                >
                  Forget
                </Button>
              </div>
            ),
          },
        ]}
        rows={rows}
        keyOf={(one) => one.group}
        empty="There are no groups."
      />
      {naming && (
        <Naming
          group={naming}
          others={rows.filter((one) => one.group !== naming.group)}
          change={change}
          onClose={() => setNaming(null)}
        />
      )}
      {looking && (
        <FacesDialog
          whose={{ group: looking.group }}
          names={[]}
          onChange={() => {
            setImage('');
            props.onChange();
          }}
          onClose={() => setLooking(null)}
        />
      )}
      <Confirm
        title={`Forget group ${forgetting?.group ?? ''}?`}
        text="All sightings of this group and their faces are deleted permanently."
        yes="Forget"
        open={forgetting !== null}
        onYes={() => {
          const one = forgetting;
          setForgetting(null);
          if (one)
            void change(
              () => correct('people forget', [], { '--group': one.group }),
              `Group ${one.group} was forgotten.`,
            );
        }}
        onClose={() => setForgetting(null)}
      />
    </section>
  );
}

function Naming(props: {
  group: Group;
  others: Group[];
  change: (run: () => Promise<void>, said: string) => Promise<void>;
  onClose: () => void;
}) {
  const [name, setName] = useState('');
  const [note, setNote] = useState('');
  const [chosen, setOther] = useState('');
  // Groups may go while this is open.
  const others = props.others.map((one) => String(one.group));
  const other = others.includes(chosen) ? chosen : (others[0] ?? '');
  const problem = nameProblem(name);
  const id = props.group.group;
  return (
    <Dialog title={`Name group ${id}`} open onClose={props.onClose}>
      <div class="stack">
        <TextField label="Name" value={name} onInput={setName} problem={problem} />
        <TextField label="Consent" value={note} onInput={setNote} help="Who consented to what, and when." />
        <div class="row row-end">
          <AsyncButton
            kind="main"
            disabled={name.trim() === '' || problem !== ''}
            run={async () => {
              const said = name.trim();
              const flags: Flags = note.trim() === '' ? {} : { '--note': note.trim() };
              await props.change(
                () => correct('people name', [String(id), said], flags),
                `Group ${id} is ${said}.`,
              );
              props.onClose();
            }}
          >
            Enrol
          </AsyncButton>
        </div>
        {props.others.length > 0 && (
          <div class="row row-fields">
            <Select
              label="Or the same person as"
              value={other}
              options={props.others.map((one) => ({
                value: String(one.group),
                label: `group ${one.group}`,
              }))}
              onChange={setOther}
            />
            <AsyncButton
              run={async () => {
                await props.change(
                  () => correct('people correct merge', [String(id), other], { '--groups': true }),
                  `Group ${id} was merged into group ${other}.`,
                );
                props.onClose();
              }}
            >
              Merge
            </AsyncButton>
          </div>
        )}
      </div>
    </Dialog>
  );
}

export function Corrections(props: { changes: number; onChange: () => void }) {
  const log = useLoad(async () => {
    if (!(await hasState('gallery'))) return [];
    const answer = await api.run('people log', [], { '--limit': 20 });
    return answer.lines.map(correctionOf).filter((one): one is Correction => one !== null);
  }, [props.changes]);
  return (
    <section class="stack" aria-labelledby="corrections">
      <h2 id="corrections">Corrections</h2>
      <Table
        caption="Latest corrections"
        hideCaption
        columns={[
          { name: 'Time', show: (one) => <Timestamp at={one.time} /> },
          { name: 'Author', show: (one) => one.who },
          { name: 'Correction', show: (one) => <span class="wrap">{correctionText(one)}</span> },
          {
            name: 'Undo',
            show: (one) =>
              one.undone || one.what === 'undo' ? (
                ''
              ) : (
                <AsyncButton
                  small
                  aria-label={`Undo correction ${one.correction}`}
                  run={async () => {
                    await attempt(async () => {
                      await correct('people correct undo', [String(one.correction)]);
                      toast('The correction was undone.', 'good');
                      props.onChange();
                    });
                  }}
                >
                  Undo
                </AsyncButton>
              ),
          },
        ]}
        rows={log.value ?? []}
        keyOf={(one) => one.correction}
        empty="No corrections yet."
      />
    </section>
  );
}
