// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

namespace tarsier::face {

// Why faces cannot be compared by the requested templates. Programs use it to suggest a solution.
enum class TemplateProblem {
  // The user's own network is given without a background.
  kNotCalibrated,
  kOtherNetwork,  // the gallery's templates are of another network than the given one
  // The templates are of the user's own network, and no network is given.
  kNetworkNotGiven,
  kNotDeep,     // deep templates were requested, the gallery has classic ones
  kNotClassic,  // classic templates were requested, the gallery has deep ones
};

// An error of a network's file (ErrorKind::kModel) or of a gallery (kInput); what() names the file
// and the problem.
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
