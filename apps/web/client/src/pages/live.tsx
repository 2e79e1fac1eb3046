import { useEffect, useState } from 'preact/hooks';
import { api, type Session, type Source } from '../api';
import { sessionName } from '../areas';
import { useEvery, useLoad, useSignalValue } from '../hooks';
import { liveSession } from '../live';
import { startAndOpen } from '../ui';
import {
  AsyncButton,
  attempt,
  Button,
  EmptyState,
  LiveStatus,
  LiveView,
  Notice,
  PageHead,
  StartDialog,
} from '../ui';

export const WALL = 9;

// How old the image is and how many come, as text; changes once a second.
export function LiveFigures({ id }: { id: string }) {
  const live = liveSession(id);
  const [text, setText] = useState('');
  useEffect(() => {
    const tell = () => {
      const shown = live.shown.peek();
      setText(shown.frame > 0 ? `${shown.fps.toFixed(0)} frames/s, ${Math.round(shown.ageMs)} ms old` : '');
    };
    const timer = setInterval(tell, 1000);
    return () => clearInterval(timer);
  }, [id]);
  return (
    <span class="figures faint" data-figures={id}>
      {text}
    </span>
  );
}

function Tile({ session, sources, onChange }: { session: Session; sources: Source[]; onChange: () => void }) {
  const ended = useSignalValue(liveSession(session.id).ended);
  const running = session.running && !ended;
  const name = sessionName(session);
  const inputs = session.inputs.map((input) => sources.find((one) => one.id === input)?.name ?? input);
  return (
    <article class="card tile" aria-label={name}>
      <a class="tile-image" href={`/session/${session.id}`} aria-label={`Open ${name}`}>
        <LiveView id={session.id} title={`Live image of ${name}`} />
      </a>
      <div class="tile-head">
        <h2>
          <a href={`/session/${session.id}`}>{name}</a>
        </h2>
        <span class={`chip ${running ? 'chip-running' : 'chip-bad'}`}>{running ? 'live' : 'ended'}</span>
      </div>
      <p class="faint tile-source">{inputs.join(', ')}</p>
      <LiveStatus id={session.id} quiet />
      <div class="row tile-foot">
        <LiveFigures id={session.id} />
        <AsyncButton
          small
          kind="quiet"
          aria-label={`${running ? 'End' : 'Remove'} ${name}`}
          run={async () => {
            await attempt(() => api.endSession(session.id));
            onChange();
          }}
        >
          {running ? 'End' : 'Remove'}
        </AsyncButton>
      </div>
    </article>
  );
}

export function Live() {
  const sessions = useLoad(api.sessions);
  const sources = useLoad(api.sources);
  const [start, setStart] = useState(false);
  useEvery(3, sessions.again);
  const all = sessions.value ?? [];
  const shown = all.slice(0, WALL);
  return (
    <>
      <PageHead
        title="Live"
        text="All running sessions. Each view shows the newest image. Hidden tabs receive no images."
      >
        <Button kind="main" onClick={() => setStart(true)}>
          Start a session
        </Button>
      </PageHead>
      {sessions.error && <Notice kind="problem">{sessions.error}</Notice>}
      {sessions.value && all.length === 0 && (
        <EmptyState
          title="No session is running"
          text="A session reads a camera, a video or a synthetic scene and shows the results."
          onSynthetic={() =>
            startAndOpen({ verb: 'cartoon run', inputs: ['synth:portrait?live=1'], flags: {} }).then(
              () => undefined,
            )
          }
        >
          <Button onClick={() => setStart(true)}>Start a session</Button>
        </EmptyState>
      )}
      {all.length > WALL && (
        <Notice>
          Showing {WALL} of {all.length} sessions.
        </Notice>
      )}
      <div class="wall">
        {shown.map((session) => (
          <Tile key={session.id} session={session} sources={sources.value ?? []} onChange={sessions.again} />
        ))}
      </div>
      <StartDialog open={start} onClose={() => setStart(false)} />
    </>
  );
}
