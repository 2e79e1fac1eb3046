// SPDX-License-Identifier: MIT
#pragma once

#include "router.h"
#include "sign_in.h"
#include <chrono>
#include <memory>
#include <string>
#include <string_view>

namespace tarsier::web {

class AuditLog;

// GET /api/sign-ins: who is signed in. DELETE /api/sign-ins/{id}: one no longer; DELETE
// /api/sign-ins: nobody but who asks. POST /api/api-token: a new token for programs. All of them
// are in the audit log.
void bind_sign_ins(Router& router, SignIns& sign_ins, AuditLog& audit);

// "Firefox on Linux" of what a browser calls itself; its first word where it is no known browser,
// "" where it says nothing.
[[nodiscard]] std::string short_agent(std::string_view agent);

// The same stream, which ends soon after the sign-in of the request does: it is looked at each
// `interval`.
[[nodiscard]] std::unique_ptr<BodyStream> while_signed_in(
    std::unique_ptr<BodyStream> stream, SignIns& sign_ins, const Request& request,
    std::chrono::milliseconds interval = std::chrono::milliseconds(500));

}  // namespace tarsier::web
