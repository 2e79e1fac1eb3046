// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <string>

namespace tarsier::face::people {

// Learned once, from people who are in no gallery.
inline const recognition::Background& gallery_background() {
  static const recognition::Background learned =
      recognition::synthetic_background(40, 1000, 30, {128, 160});
  return learned;
}

// Of the error that `call` throws; empty if it throws none.
template <typename Call>
std::string message_of(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace tarsier::face::people
