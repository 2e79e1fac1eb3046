import { PageHead } from '../ui';

export function SessionPage() {
  return <PageHead title="SessionPage" text="This page is being built." />;
}
