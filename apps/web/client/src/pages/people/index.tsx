// The gallery: who is enrolled, adding people, naming them, forgetting them.
import { useState } from 'preact/hooks';
import { api } from '../../api';
import { bytesText } from '../../format';
import { useLoad } from '../../hooks';
import {
  AsyncButton,
  Button,
  Confirm,
  Dialog,
  JobCard,
  Timestamp,
  Notice,
  PageHead,
  Select,
  Table,
  Tabs,
} from '../../ui';
import { attempt, toast } from '../../ui/toast';
import { hasState, save } from '../shared/files';
import { settleJob, useJob } from '../shared/jobs';
import { Enrol } from './enrol';
import { FacesDialog } from './faces';
import { correct } from './correct';
import { Corrections, Groups } from './groups';
import { Identify } from './identify';
import { LivePeople } from './live_people';
import { personOf, proofOf, sightingOf, type Person, type Proof } from './model';

const tabs = [
  { id: 'gallery', label: 'Gallery' },
  { id: 'add', label: 'Enrol a person' },
  { id: 'who', label: 'Identify' },
  { id: 'live', label: 'Live' },
];

export function People() {
  const [tab, setTab] = useState('gallery');
  const people = useLoad(async () => {
    if (!(await hasState('gallery'))) return [];
    const answer = await api.run('people list');
    return answer.lines.map(personOf).filter((one): one is Person => one !== null);
  });
  return (
    <>
      <PageHead
        title="People"
        text="Enrols people, identifies their faces or reports them as unknown, and deletes their data permanently. All data stays on this machine."
      />
      <Tabs label="People" tabs={tabs} value={tab} onChange={setTab}>
        {tab === 'gallery' && (
          <Gallery
            people={people.value ?? []}
            error={people.error}
            again={people.again}
            onAdd={() => setTab('add')}
          />
        )}
        {tab === 'add' && (
          <Enrol people={people.value ?? []} onEnrolled={people.again} onNext={() => setTab('who')} />
        )}
        {tab === 'who' && <Identify people={people.value ?? []} />}
        {tab === 'live' && <LivePeople onChange={people.again} />}
      </Tabs>
    </>
  );
}

function Gallery(props: { people: Person[]; error: string; again: () => void; onAdd: () => void }) {
  const [forgetting, setForgetting] = useState<string | null>(null);
  const [looking, setLooking] = useState<string | null>(null);
  const [proof, setProof] = useState<Proof | null>(null);
  const [exported, setExported] = useState<string>();
  const job = useJob(exported);
  const [keep, setKeep] = useState('30d');
  const sightings = useLoad(async () => {
    if (!(await hasState('gallery'))) return [];
    const answer = await api.run('people list', [], { '--sightings': true, '--limit': 100 });
    return answer.lines.map(sightingOf).filter((one) => one !== null);
  });
  // Counts corrections: what shows the gallery looks again.
  const [changes, setChanges] = useState(0);
  const changed = () => {
    setChanges((before) => before + 1);
    props.again();
    sightings.again();
  };
  const forget = async (name: string) => {
    setForgetting(null);
    await attempt(async () => {
      // As a job, as searching a large workspace takes its time; its record has the name and goes with it.
      const job = await settleJob({
        verb: 'people forget',
        inputs: [name],
        flags: {},
        name: 'Forget a person',
      });
      const found = job.lines.map(proofOf).find((one) => one !== null);
      await api.removeJob(job.id).catch(() => undefined);
      if (!found) throw new Error(job.error ?? 'This person could not be forgotten.');
      setProof(found);
      changed();
    });
  };
  return (
    <div class="stack">
      {props.error && <Notice kind="problem">{props.error}</Notice>}
      <section class="stack" aria-labelledby="enrolled">
        <h2 id="enrolled">Enrolled people</h2>
        <Table
          caption="People of the gallery"
          hideCaption
          columns={[
            { name: 'Name', show: (one) => <strong class="wrap">{one.name}</strong> },
            { name: 'Faces', show: (one) => one.faces, number: true },
            { name: 'Consent', show: (one) => one.note || 'no note' },
            { name: 'Enrolled', show: (one) => <Timestamp at={one.time} /> },
            {
              name: 'Actions',
              show: (one) => (
                <div class="row">
                  <Button small aria-label={`Faces of ${one.name}`} onClick={() => setLooking(one.name)}>
                    Faces
                  </Button>
                  <Button
                    small
                    kind="danger"
                    aria-label={`Forget ${one.name}`}
                    onClick={() => setForgetting(one.name)}
                  >
                    Forget
                  </Button>
                </div>
              ),
            },
          ]}
          rows={props.people}
          keyOf={(one) => one.name}
          empty="Nobody is enrolled."
        />
        <div class="row">
          <Button kind="main" onClick={props.onAdd}>
            Enrol a person
          </Button>
          <AsyncButton
            disabled={props.people.length === 0}
            run={async () => {
              const started = await attempt(() =>
                api.startJob({
                  verb: 'people export',
                  inputs: [],
                  flags: { '--output': 'out:gallery' },
                  name: 'Export of the gallery',
                }),
              );
              if (started) setExported(started.id);
            }}
          >
            Export all stored data
          </AsyncButton>
        </div>
        {job && (
          <>
            <JobCard job={job} onChange={() => setExported(undefined)} />
            <p class="field-help">
              Remove the export from the server after the download. When you forget a person, copies of the
              data in exports are reported.
            </p>
          </>
        )}
      </section>
      <Groups changes={changes} onChange={changed} />
      <section class="stack" aria-labelledby="sightings">
        <h2 id="sightings">Sightings</h2>
        <p class="field-help">
          Live recognition can store when each person was seen, with the face, also for unknown people. This
          list is personal data: keep it no longer than needed.
        </p>
        <Table
          caption="Latest sightings"
          hideCaption
          columns={[
            { name: 'Time', show: (one) => <Timestamp at={one!.time} /> },
            { name: 'Person', show: (one) => (one!.known ? one!.label : 'unknown') },
            { name: 'Confidence', show: (one) => `${(100 * one!.confidence).toFixed(0)} %`, number: true },
            { name: 'Source', show: (one) => one!.source },
            {
              name: 'Correct',
              show: (one) =>
                one!.known && one!.face ? (
                  <AsyncButton
                    small
                    aria-label={`Not this person: sighting ${one!.id}`}
                    run={async () => {
                      await attempt(async () => {
                        await correct('people correct not', [], { '--sighting': one!.id });
                        toast(`Recorded: not ${one!.label}.`, 'good');
                        changed();
                      });
                    }}
                  >
                    Not this person
                  </AsyncButton>
                ) : (
                  ''
                ),
            },
          ]}
          rows={sightings.value ?? []}
          keyOf={(_, i) => i}
          empty="No sightings are stored."
        />
        <div class="row row-fields">
          <Select
            label="Keep sightings"
            value={keep}
            options={[
              { value: '1d', label: 'for a day' },
              { value: '7d', label: 'for a week' },
              { value: '30d', label: 'for 30 days' },
              { value: '90d', label: 'for 90 days' },
            ]}
            onChange={setKeep}
          />
          <AsyncButton
            disabled={(sightings.value ?? []).length === 0}
            run={async () => {
              await attempt(async () => {
                const answer = await api.run('people list', [], { '--keep': keep });
                if (answer.exit !== 0 && answer.error) throw new Error(answer.error);
                toast('Older sightings were deleted.', 'good');
                changed();
              });
            }}
          >
            Delete older sightings
          </AsyncButton>
        </div>
      </section>
      <Corrections changes={changes} onChange={changed} />
      {looking !== null && (
        <FacesDialog
          whose={{ person: looking }}
          names={props.people.map((one) => one.name)}
          onChange={changed}
          onClose={() => setLooking(null)}
        />
      )}
      <Confirm
        title={`Forget ${forgetting ?? ''}?`}
        text="All faces, templates and sightings of this person are deleted permanently. Then all files of the workspace are searched for the deleted data, and the proof is shown."
        yes="Forget"
        open={forgetting !== null}
        onYes={() => void (forgetting !== null && forget(forgetting))}
        onClose={() => setForgetting(null)}
      />
      <Dialog title="Forgotten" open={proof !== null} onClose={() => setProof(null)} wide>
        {proof && <ProofView proof={proof} />}
      </Dialog>
    </div>
  );
}

function ProofView({ proof }: { proof: Proof }) {
  return (
    <div class="stack">
      {proof.proven ? (
        <Notice kind="good">
          {proof.name}: {proof.faces} faces and {proof.sightings} sightings were removed. None of them remains
          in the files of this workspace.
        </Notice>
      ) : (
        <Notice kind="problem">
          {proof.name} was removed from the gallery, but it is not proven that no data remains.
        </Notice>
      )}
      <dl class="state-list">
        <div>
          <dt>Data items searched for</dt>
          <dd>
            {proof.pieces_searched} of {proof.pieces}
          </dd>
        </div>
        <div>
          <dt>Files searched</dt>
          <dd>
            {proof.searched.length}, {bytesText(proof.bytes)}
          </dd>
        </div>
      </dl>
      {proof.left_in.length > 0 && (
        <>
          <p>Data remains in these files. Delete the files, then search again:</p>
          <ul class="file-list">
            {proof.left_in.map((one) => (
              <li key={one}>{one}</li>
            ))}
          </ul>
        </>
      )}
      {proof.unproven > 0 && (
        <p>
          {proof.unproven} faces or templates could not be searched for: another person has the same data (
          {proof.shared_with.join(', ')}).
        </p>
      )}
      {[...proof.unread, ...proof.skipped].length > 0 && (
        <p>Files not searched: {[...proof.unread, ...proof.skipped].slice(0, 20).join(', ')}</p>
      )}
      <p class="field-help">
        Backups and other disks are not searched. Uploaded images show the face in another form: their sets
        remain until you remove them.
      </p>
      <div class="row row-end">
        <Button
          onClick={() =>
            save('proof.json', new Blob([JSON.stringify(proof, null, 1)], { type: 'application/json' }))
          }
        >
          Download the proof
        </Button>
      </div>
    </div>
  );
}
