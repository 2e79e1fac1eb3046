import { PageHead } from '../ui';

export function Annotate() {
  return <PageHead title="Annotate" text="This page is being built." />;
}
