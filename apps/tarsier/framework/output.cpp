// SPDX-License-Identifier: MIT
#include "output.h"

#include "tarsier/core/errors.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

namespace tarsier::cli {

void print_text(std::string_view text) {
  const bool whole = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
  if (!whole || std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    throw OutputError("standard output", std::strerror(errno));
  }
}

void print_json(const nlohmann::ordered_json& object) { print_text(json_text(object) + '\n'); }

std::string json_text(const nlohmann::ordered_json& object) {
  return object.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

double rounded(double value, int digits) {
  constexpr double kSteps[] = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};
  const double steps = kSteps[digits];
  return std::isfinite(value) ? std::round(value * steps) / steps : value;
}

}  // namespace tarsier::cli
