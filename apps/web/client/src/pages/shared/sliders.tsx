// The sliders of a session, in groups: of many like ones the first few, the others on request.
import { useState } from 'preact/hooks';
import type { SliderInfo } from '../../api';
import { useSignalValue } from '../../hooks';
import { liveSession } from '../../live';
import { capital } from '../../format';
import { Button, Slider } from '../../ui';
import { actionCount, sendEvent } from '../../ui/live_view';
import { groupsOf, type SliderGroup } from './slider_groups';

const FIRST = 4; // of a group, where it is longer

export function GroupedSliders({ id, sliders }: { id: string; sliders: SliderInfo[] }) {
  if (sliders.length === 0) return null;
  const groups = groupsOf(sliders);
  const several = groups.filter((group) => group.sliders.length > FIRST).length > 0;
  return (
    <div class="sliders">
      {groups.map((group) =>
        several && group.name !== '' ? (
          <Group key={group.name} id={id} group={group} />
        ) : (
          group.sliders.map((slider) => <One key={slider.name} id={id} slider={slider} />)
        ),
      )}
    </div>
  );
}

function Group({ id, group }: { id: string; group: SliderGroup }) {
  const [all, setAll] = useState(false);
  const values = useSignalValue(liveSession(id).state)?.sliders ?? {};
  const rest = group.sliders.slice(FIRST);
  const off = group.sliders.filter((one) => Math.abs((values[one.name] ?? one.value) - middleOf(one)) > 1e-9);
  return (
    <fieldset class="slider-group">
      <legend>
        {capital(group.name)}: {group.sliders.length} modes
      </legend>
      {group.sliders.slice(0, FIRST).map((slider) => (
        <One key={slider.name} id={id} slider={slider} />
      ))}
      {all && rest.map((slider) => <One key={slider.name} id={id} slider={slider} />)}
      <div class="row">
        {rest.length > 0 && (
          <Button small aria-expanded={all} onClick={() => setAll(!all)}>
            {all ? 'Show fewer modes' : `All ${group.sliders.length} modes of ${group.name}`}
          </Button>
        )}
        <Button
          small
          disabled={off.length === 0}
          onClick={() => {
            for (const one of off) sendEvent(id, { slider: one.name, value: middleOf(one) });
          }}
        >
          Reset {group.name}
        </Button>
      </div>
    </fieldset>
  );
}

const middleOf = (slider: SliderInfo) => (slider.low + slider.high) / 2;

function One({ id, slider }: { id: string; slider: SliderInfo }) {
  const state = useSignalValue(liveSession(id).state);
  const actions = useSignalValue(actionCount);
  return (
    <Slider
      round={actions}
      label={capital(slider.name.replaceAll('-', ' '))}
      value={state?.sliders?.[slider.name] ?? slider.value}
      low={slider.low}
      high={slider.high}
      step={slider.step}
      onChange={(value) => sendEvent(id, { slider: slider.name, value })}
    />
  );
}
