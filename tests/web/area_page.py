# SPDX-License-Identifier: MIT
"""What the tests of the areas' pages have in common."""

import os
import unittest

import pages

LONG = pages.LONG
# Every screen of every path at every width, for people who look at them: TARSIER_WEB_LOOK=1.
WIDTHS = (360, 800, 1440) if os.environ.get("TARSIER_WEB_LOOK") else (360,)


long = unittest.skipUnless(os.environ.get("TARSIER_TEST_ALL"), "long: ./test --all runs it")


class AreaPageTest(pages.PageTest):
    """One server and one browser for all. Tests go in the order of their names."""

    def path(self, name):
        """A page of a path is judged like all others."""
        self.judge(f"path-{name}", widths=WIDTHS)

    def started(self, verb):
        """How many jobs of a verb there will be with the next one."""
        return 1 + len(self.jobs_of(verb))

    def job_of(self, verb, at_least=1):
        """The newest job of a verb, when it is over, and so many of them are there."""

        def over():
            jobs = self.jobs_of(verb)
            job = max(jobs, key=lambda one: str(one["created"]), default=None)
            return len(jobs) >= at_least and job["state"] not in ("queued", "running") and job

        return self.server.call(f"/api/jobs/{self.until(f'a job of {verb} ended', over)['id']}")[1]

    def state(self, verb):
        """The state of the running session of a verb."""
        for one in self.server.call("/api/sessions")[1]["sessions"]:
            if one["verb"] == verb and one["running"]:
                return self.server.call(f"/api/sessions/{one['id']}")[1]
        return None

    def values(self, verb):
        """What that session says of itself; empty before its first image."""
        return (self.state(verb) or {}).get("state") or {}

    def named(self, role, part):
        return next(name for _, name, _ in self.page.find_all(role) if part in name)
