// Recognising, and adding, people before a camera.
import { useState } from 'preact/hooks';
import type { Json } from '../../api';
import { AsyncButton, Checkbox, Notice, Select, Table, TextField } from '../../ui';
import {
  filled,
  SessionActions,
  SessionPanel,
  SourceSelect,
  StateList,
  useSessionState,
} from '../shared/parts';
import { useAreaSession } from '../shared/sessions';

const portrait = { id: 'synth:portrait?live=1', name: 'Synthetic portrait' };

interface Recognised {
  label: string | null;
  known: boolean;
  confidence: number;
  group?: number | null; // of an unknown face
}

const personText = (one: Recognised) =>
  one.known && one.label !== null
    ? one.label
    : typeof one.group === 'number'
      ? `unknown, group ${one.group}`
      : 'unknown';

// Of the lists of groups, people, faces and corrections, over the image.
const listActions = [
  'groups',
  'people',
  'log',
  'name',
  'up',
  'down',
  'open',
  'back',
  'mark',
  'merge',
  'split',
  'forget',
];

const recognisedOf = (value: Json | undefined): Recognised[] =>
  Array.isArray(value) ? (value as unknown as Recognised[]) : [];

export function LivePeople(props: { onChange: () => void }) {
  const adding = useAreaSession('people live');
  const naming = useAreaSession('people identify');
  const session = adding.id !== undefined ? adding : naming;
  const [mode, setMode] = useState<'identify' | 'live'>('identify');
  const [source, setSource] = useState(portrait.id);
  const [keep, setKeep] = useState('');
  const [names, setNames] = useState('');
  const [note, setNote] = useState('');
  const [agreed, setAgreed] = useState(false);
  const state = useSessionState(session.id);
  const start = async () => {
    if (mode === 'live') {
      await adding.start(
        [source],
        filled({ '--names': names.trim(), '--note': note.trim(), '--keep': keep }),
        'Enrol people',
      );
    } else {
      await naming.start([source], filled({ '--keep': keep }), 'Identify people');
    }
  };
  if (session.id !== undefined) {
    const faces = recognisedOf(state.recognized);
    const prompt = typeof state.prompt === 'string' ? state.prompt : '';
    const message = typeof state.message === 'string' ? state.message : '';
    return (
      <div class="split">
        <SessionPanel
          id={session.id}
          title="People in front of the camera"
          onEnd={async () => {
            await session.end();
            props.onChange();
          }}
        />
        <div class="stack">
          {adding.id !== undefined && (
            <>
              <SessionActions
                id={session.id}
                label="Actions"
                names={['add', 'train', 'not', 'undo', 'delete', 'confirm', 'cancel', 'debug', 'pause']}
              />
              <SessionActions id={session.id} label="Lists of groups and corrections" names={listActions} />
            </>
          )}
          {adding.id === undefined && (
            <SessionActions id={session.id} label="Actions" without={['quit', 'help']} />
          )}
          {(prompt || message) && (
            <p class="numbers" role="status">
              {[message, prompt].filter((one) => one !== '').join('. ')}
            </p>
          )}
          <StateList
            state={state}
            names={{ mode: 'Mode', faces: 'Faces', known: 'Known', collecting: 'Collecting' }}
          />
          {faces.length > 0 && (
            <Table
              caption="Identified people"
              columns={[
                { name: 'Person', show: personText },
                { name: 'Confidence', show: (one) => `${(100 * one.confidence).toFixed(0)} %`, number: true },
              ]}
              rows={faces}
              keyOf={(_, i) => i}
            />
          )}
        </div>
      </div>
    );
  }
  const ready = mode === 'identify' || (agreed && note.trim() !== '');
  return (
    <section class="card stack" aria-labelledby="live-people">
      <h2 id="live-people">Live camera</h2>
      <SourceSelect label="Source" value={source} own={portrait} onChange={setSource} />
      <Select
        label="What to do"
        value={mode}
        options={[
          { value: 'identify', label: 'Identify people' },
          { value: 'live', label: 'Enrol people, then identify them' },
        ]}
        onChange={(value) => setMode(value as 'identify' | 'live')}
      />
      <Select
        label="Keep sightings"
        value={keep}
        options={[
          { value: '', label: 'do not keep them' },
          { value: '1d', label: 'for a day' },
          { value: '7d', label: 'for a week' },
          { value: '30d', label: 'for 30 days' },
        ]}
        onChange={setKeep}
      />
      {mode === 'live' && (
        <>
          <Notice>A face template is biometric data. Ask each person first, and record the consent.</Notice>
          <TextField
            label="Names, in the order of enrolment"
            value={names}
            onInput={setNames}
            placeholder="Ann,Ben"
            help="Separate names with commas. Without names they are called Person 1, Person 2 ..."
          />
          <TextField label="Consent" value={note} onInput={setNote} required />
          <Checkbox label="These people have given consent" checked={agreed} onChange={setAgreed} />
        </>
      )}
      <div class="row">
        <AsyncButton kind="main" disabled={!ready} run={start}>
          Start
        </AsyncButton>
      </div>
    </section>
  );
}
