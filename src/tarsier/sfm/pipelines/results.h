// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

// The result folder of `sfm reconstruct`, from one run to the next.
namespace tarsier::sfm {

// What an earlier run wrote to `folder`, according to its report.json.
struct EarlierRun {
  int models = 0;
  int registered = 0;  // images of the largest model
  bool partial = false;
};
// Empty where no report.json of this program exists.
[[nodiscard]] std::optional<EarlierRun> earlier_run(const std::string& folder);

// The image files of a model in `folder`, by name. `images` is their folder. Where it is empty,
// folder/images and folder/frames are searched, then the paths in report.json, but only with
// `is_report_trusted`: a report may name any file of this machine. Throws InputError for the first
// image that is not found.
[[nodiscard]] std::map<std::string, std::string> image_files(const std::string& folder,
                                                             const std::string& images,
                                                             const std::vector<std::string>& names,
                                                             bool is_report_trusted = true);

// The folder of a model: model 0 is in `folder` itself, the others in model-1, model-2 ...
[[nodiscard]] std::string model_folder(const std::string& folder, int model);

// Creates the folder of a further model, with a report.json that marks it as such. Throws
// OutputError.
void begin_model_folder(const std::string& folder, int model);

// Removes the binary model, the rigs and the frames of an earlier run from a model folder that has
// a report.json. COLMAP prefers them to text, so beside a new text model it would read the old one.
// Without a report.json nothing is removed: then the files are not of this program. Throws
// OutputError.
void remove_replaced_files(const std::string& folder);

// Removes the models `first` (1 or more) and above of an earlier run. A folder model-K is affected
// where `earlier` has that model or its own report.json says so. Only the files that a run writes
// are removed, then the folder if it is empty. Other files and folders stay. Returns the number of
// folders from which something was removed. Never throws.
int remove_old_models(const std::string& folder, int first,
                      const std::optional<EarlierRun>& earlier);

}  // namespace tarsier::sfm
