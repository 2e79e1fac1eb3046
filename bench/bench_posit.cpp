// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head/posit_study.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>

#include "bench.h"
#include <nlohmann/json.hpp>

namespace tarsier::cli {

ExitStatus bench_posit(Context& context, const BenchOptions& options) {
  const std::string path =
      ModelStore::find().path_or(options.inputs.empty() ? "" : options.inputs[0], "head.json");
  const face::head::HeadModel model = face::head::read_head_model(path);
  face::head::PositStudyOptions study;
  study.seed = context.seed;
  // The nose tip, if the markup has one.
  study.reference = model.points() == 68 ? 30 : 0;
  const auto rows = face::head::run_posit_study(model.mean, study, context.stop);
  if (!context.json)
    print_text(fmt::format("{:>22} {:>9} {:>9} {:>9} {:>8} {:>9}\n", "method", "noise px",
                           "rot. deg", "tr. mm", "us", "failures"));
  for (const face::head::PositStudyRow& row : rows) {
    if (!is_chosen(options, row.method)) continue;
    if (context.json) {
      print_json(
          nlohmann::ordered_json{{"bench", "posit"},
                                 {"case", fmt::format("{}, noise {} px", row.method, row.noise_px)},
                                 {"method", row.method},
                                 {"noise_px", row.noise_px},
                                 {"rotation_deg", rounded(row.rotation_deg, 5)},
                                 {"translation_mm", rounded(row.translation_mm, 4)},
                                 {"us", rounded(row.us, 2)},
                                 {"failures", row.failures}});
    } else {
      print_text(fmt::format("{:>22} {:>9.1f} {:>9.4f} {:>9.3f} {:>8.1f} {:>9}\n", row.method,
                             row.noise_px, row.rotation_deg, row.translation_mm, row.us,
                             row.failures));
    }
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
