import { PageHead } from '../ui';

export function People() {
  return <PageHead title="People" text="This page is being built." />;
}
