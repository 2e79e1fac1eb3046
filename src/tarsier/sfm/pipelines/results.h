// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

// What `sfm reconstruct` leaves in its folder, from one run to the next.
namespace tarsier::sfm {

// What an earlier run wrote into `folder`, by its report.json.
struct EarlierRun {
  int models = 0;
  int registered = 0;  // images of the largest
  bool partial = false;
};
// Nothing where there is no report.json that this program wrote.
[[nodiscard]] std::optional<EarlierRun> earlier_run(const std::string& folder);

// Where the images of a model in `folder` are, by name. `images` is their folder; empty: folder/images
// and folder/frames are looked into, then the files that report.json names, unless it is not to be
// trusted: it may name any file of this machine. Throws InputError for the first image that is nowhere.
[[nodiscard]] std::map<std::string, std::string> image_files(const std::string& folder,
                                                             const std::string& images,
                                                             const std::vector<std::string>& names,
                                                             bool is_report_trusted = true);

// The folder of a model: 0 is `folder` itself, the others are model-1, ...
[[nodiscard]] std::string model_folder(const std::string& folder, int model);

// The folder of a further model, with a report.json that says whose it is. Throws OutputError.
void begin_model_folder(const std::string& folder, int model);

// Takes away the models `first` (1 or more) and above of an earlier run: of each folder model-K
// that `earlier` had, or whose own report.json says so, the files that a run writes, and the folder
// where nothing else is in it. Files of others stay, and so does a folder of that name that no run
// wrote. Returns how many folders had something taken away. Never throws.
int remove_old_models(const std::string& folder, int first,
                      const std::optional<EarlierRun>& earlier);

}  // namespace tarsier::sfm
