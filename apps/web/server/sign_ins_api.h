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

// Adds GET /api/sign-ins: list; DELETE /api/sign-ins/{id}: ends one; DELETE /api/sign-ins: ends all
// except that of the request; POST /api/api-token: a new token for programs. All are recorded in
// the audit log.
void bind_sign_ins(Router& router, SignIns& sign_ins, AuditLog& audit);

// Shortens a browser's user agent to "Firefox on Linux"; to its first word for unknown browsers; ""
// if it is empty.
[[nodiscard]] std::string short_agent(std::string_view agent);

// Wraps a stream so that it ends soon after the sign-in of the request ends; checked every
// `interval`.
[[nodiscard]] std::unique_ptr<BodyStream> while_signed_in(
    std::unique_ptr<BodyStream> stream, SignIns& sign_ins, const Request& request,
    std::chrono::milliseconds interval = std::chrono::milliseconds(500));

}  // namespace tarsier::web
