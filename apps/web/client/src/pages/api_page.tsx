import { PageHead } from '../ui';

export function ApiPage() {
  return <PageHead title="ApiPage" text="This page is being built." />;
}
