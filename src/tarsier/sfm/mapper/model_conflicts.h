// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <map>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// Places that look alike and that a model lays one over the other: the sides of a symmetrical object, two houses of one
// make. Found by what is missing where the poses of the model predict it (after Heinly, Dunn and Frahm, Correcting for
// duplicate scene structure in sparse 3D reconstruction, ECCV 2014).
//
// Two images are near where their rays to a point of one of them differ by less than 12 degrees, at distances within a
// factor of 1.3. The other image should then show the point. It does where it has a feature, of whatever track, within
// 2.5 px of its projection (in an image of 1000 px); what chance gives is measured at places beside it and taken off.
// A point that fewer images show than should (below 0.7 of the rate of most) tells places apart, or its detection is
// unsure. Unsure points are missing here and there. Of two places laid over each other, the points of one are missing in
// all images of the other, and the other way round. Images that are farther from each other share fewer unsure points; so
// two are judged by what the best of those share that are at least as far apart (the share of 9 of 10 is below it), where
// that is 0.35 or more of what is expected. A point that few images should show is also rare because the other image does
// not show it; so two do not contradict each other where it shows 0.4 or more of the points that are rare without it, four
// of which are expected or more.
class ModelConflicts {
 public:
  // What two near images, or the images around them, should share of points that tell places apart.
  struct Evidence {
    double expected = 0;
    double found = 0;  // beyond chance
  };

  // One thread, no random numbers.
  explicit ModelConflicts(const Model& model);

  // Near images that contradict each other: of 8 points or more, less than 0.15 are shared, and less than a quarter of
  // what is usual so far apart. By first, then second; first < second.
  [[nodiscard]] const std::vector<std::pair<int, int>>& pairs() const { return pairs_; }
  // Whether these are more than chance gives: three or more, and one in 200 of the near images with as much evidence. But
  // where the scene is known to repeat, two more conditions hold.
  // Three or more contradict one and the same image, a fifth of those with as much evidence, and one of these has nearly
  // its view: the angle of their rays in units of 12 degrees plus the logarithm of the ratio of their distances in units of
  // that of 1.3 is less than 1. Of many images a few lack by chance what one other should share, here and there, and images
  // of a slanted surface from afar more; an image in a wrong place contradicts most around it, and the nearest too.
  // And an image, two where 200 or more are compared, is contradicted by three or more that are of different places as a
  // whole (are_different()), or one in ten of those with as much evidence contradict each other. Of thousands of images
  // that are as near as those of a video, each point is a feature in few, so that what two images share scatters; what all
  // images of two places share does not, but that of an image that has few features of its neighbours.
  [[nodiscard]] bool any(bool repeats = false) const;
  // Sums up what is known of two images: of them, and of the images that are of one place with either.
  [[nodiscard]] Evidence between(int first, int second) const;
  // Whether the two show different places by that, or all images of their places do: 20 points or more are expected, and
  // few of them are found beside what near images of one place share.
  [[nodiscard]] bool are_different(int first, int second) const;
  // Of each image: 0 to 1, how many of the near images it contradicts, of those with as much evidence.
  [[nodiscard]] const std::vector<double>& shares() const { return shares_; }

 private:
  struct Near {
    int image;
    Evidence evidence;
    double distance;  // between them: Comparison::distance()
  };
  [[nodiscard]] const Evidence* find(int first, int second) const;
  [[nodiscard]] std::vector<int> same_place(int image) const;
  void find_places();
  [[nodiscard]] bool is_little(const Evidence& evidence) const;
  std::vector<std::vector<Near>> near_;  // of each image, by image
  std::vector<std::pair<int, int>> pairs_;
  std::size_t judged_ = 0;             // near images with as much evidence
  bool is_clustered_ = false;          // some image is contradicted by several
  bool has_different_places_ = false;  // .. also as all images of their places are compared
  std::vector<double> shares_;
  std::vector<int> place_;  // of each image: one of the images of its place
  std::map<std::pair<int, int>, Evidence> between_places_;  // lower number first
  double usual_ = 1;  // share of what is expected that images of one place have
};

// The pairs by which a model laid different places over each other: they join such places, and a fifth of their matches
// or more are points of the model. A right pair between two such places is not: the model has its images elsewhere.
// Where there is no such pair, all that join different places.
[[nodiscard]] std::vector<const Pair*> conflicting_pairs(const Model& model,
                                                         const ModelConflicts& conflicts,
                                                         const std::vector<const Pair*>& pairs);

}  // namespace tarsier::sfm
