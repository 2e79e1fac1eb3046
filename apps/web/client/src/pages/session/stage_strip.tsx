// What each stage of the work left, beside the image.
import { useEffect, useState } from 'preact/hooks';
import { api, errorText } from '../../api';
import { parseStages } from '../../stages';
import { Dialog, Notice } from '../../ui';

const PAUSE = 400; // ms between two questions: stages are to be looked at, not to be watched

interface Shown {
  name: string;
  address: string; // of a blob
  width: number;
  height: number;
}

// The newest stages, asked for while the tab is visible.
function useStages(id: string): { frame: number; list: Shown[]; error: string; waited: boolean } {
  const [state, setState] = useState<{ frame: number; list: Shown[] }>({ frame: -1, list: [] });
  const [error, setError] = useState('');
  const [waited, setWaited] = useState(false);
  useEffect(() => {
    const stop = new AbortController();
    let last = 0;
    let timer: ReturnType<typeof setTimeout> | undefined;
    let before: Shown[] = [];
    const drop = (list: Shown[]) => {
      for (const one of list) URL.revokeObjectURL(one.address);
    };
    const ask = async () => {
      try {
        if (document.visibilityState === 'visible') {
          const answer = await api.stages(id, last, stop.signal);
          if (stop.signal.aborted) return;
          setWaited(answer === null && last === 0);
          if (answer) {
            last = answer.number;
            const { frame, list } = parseStages(answer.bytes);
            const shown = list.map(({ name, width, height, jpeg }) => ({
              name,
              width,
              height,
              address: URL.createObjectURL(new Blob([jpeg as BlobPart], { type: 'image/jpeg' })),
            }));
            setState({ frame, list: shown });
            drop(before);
            before = shown;
          }
        }
        setError('');
        timer = setTimeout(() => void ask(), PAUSE);
      } catch (problem) {
        if (stop.signal.aborted) return;
        setError(errorText(problem));
      }
    };
    void ask();
    return () => {
      stop.abort();
      clearTimeout(timer);
      drop(before);
    };
  }, [id]);
  return { ...state, error, waited };
}

export function StageStrip({ id }: { id: string }) {
  const { frame, list, error, waited } = useStages(id);
  const [chosen, setChosen] = useState<string | null>(null);
  const large = list.find((one) => one.name === chosen);
  return (
    <section class="stages" aria-label="Stages">
      {error && <Notice kind="problem">{error}</Notice>}
      {list.length === 0 && !error && (
        <p class="faint">
          {waited
            ? 'The stages appear with the next frame. If the session is paused, resume it.'
            : 'Loading the stages.'}
        </p>
      )}
      {list.length > 0 && (
        <>
          <ol class="stage-row" data-frame={frame}>
            {list.map((stage, index) => (
              <li key={`${index} ${stage.name}`}>
                <button
                  type="button"
                  aria-label={`Enlarge stage ${index + 1}, ${stage.name}`}
                  onClick={() => setChosen(stage.name)}
                >
                  <img src={stage.address} alt="" width={stage.width} height={stage.height} />
                  <span>
                    {index + 1}. {stage.name}
                  </span>
                </button>
              </li>
            ))}
          </ol>
          <p class="field-help">
            {list.length} stages of frame {frame}, in processing order.
          </p>
        </>
      )}
      <Dialog title={chosen ?? 'Stage'} open={large !== undefined} onClose={() => setChosen(null)} wide>
        {large && (
          <img
            class="stage-large"
            src={large.address}
            alt={`The stage ${large.name}`}
            width={large.width}
            height={large.height}
          />
        )}
      </Dialog>
    </section>
  );
}
