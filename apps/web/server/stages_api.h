// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier::web {

class Live;
class Router;

// Adds GET /api/sessions/{id}/stages?after=N: the stage images of a frame, for sessions whose verb
// has --debug-dir ("stages": true in the Session). The body is record D of pipe_window.h, without
// length and kind; the header X-Tarsier-Stages is its number. Waits up to 2 s for one newer than N;
// 204 if none arrived, 409 if the session has no stages.
void bind_stages(Router& router, const Live& live);

}  // namespace tarsier::web
