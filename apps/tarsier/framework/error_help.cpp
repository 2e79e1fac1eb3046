// SPDX-License-Identifier: MIT
#include "framework/error_help.h"

#include "tarsier/face/pipelines/template_error.h"

namespace tarsier::cli {

std::string error_help(const std::exception& error) {
  using face::TemplateProblem;
  const auto* templates = dynamic_cast<const face::TemplateError*>(&error);
  if (templates == nullptr) return {};
  switch (templates->problem()) {
    case TemplateProblem::kNotCalibrated:
      return ": `people train --learn-background LIST --embedding FILE -o B.json` learns how "
             "strangers score, --background B.json "
             "names it";
    case TemplateProblem::kOtherNetwork:
      return ": `people train --embedding FILE` makes them again";
    case TemplateProblem::kNetworkNotGiven:
      return ": --embedding names that file, `people train --template deep or classic` makes "
             "others";
    case TemplateProblem::kNotDeep:
      return ": `people train --template deep` makes them again";
    case TemplateProblem::kNotClassic:
      return ": `people train --template classic` makes them again";
  }
  return {};
}

}  // namespace tarsier::cli
