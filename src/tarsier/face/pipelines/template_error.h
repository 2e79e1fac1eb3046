// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

namespace tarsier::face {

// Why faces cannot be compared by the templates that were asked for. A program says by it what to do.
enum class TemplateProblem {
  kNotCalibrated,    // a network of the user's own is given without a background
  kOtherNetwork,     // the gallery's templates are not of the network that is given
  kNetworkNotGiven,  // they are of a network of the user's own, and none is given
  kNotDeep,          // deep templates were asked for, it has classic ones
  kNotClassic,       // the other way round
};

// Of a network's file (ErrorKind::kModel) or of a gallery (kInput); what() names it and the problem.
class TemplateError : public IoError {
 public:
  TemplateError(TemplateProblem problem, std::string path, const std::string& reason)
      : IoError(problem == TemplateProblem::kNotCalibrated ? ErrorKind::kModel : ErrorKind::kInput,
                std::move(path), reason),
        problem_(problem) {}
  [[nodiscard]] TemplateProblem problem() const { return problem_; }

 private:
  TemplateProblem problem_;
};

}  // namespace tarsier::face
