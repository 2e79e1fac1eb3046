// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/media/archive.h"

#include <nlohmann/json.hpp>

namespace tarsier::face {
namespace {

constexpr int kVersion = 1;

}  // namespace

void write_face_networks(const std::string& path, const FaceNetworks& networks,
                         const nlohmann::json& provenance) {
  networks.require();
  write_archive(path, {std::string(kFaceNetworksType),
                       kVersion,
                       provenance,
                       {{"scan", linalg::network_to_json(networks.scan)},
                        {"judge", linalg::network_to_json(networks.judge)},
                        {"check", linalg::network_to_json(networks.check)},
                        {"sure", networks.sure},
                        {"likely", networks.likely}}});
}

FaceNetworks read_face_networks(const std::string& path) {
  const Archive archive = read_archive(path, kFaceNetworksType, kVersion);
  FaceNetworks networks;
  networks.scan = linalg::network_from_json(member(archive.payload, "scan", path), path);
  networks.judge = linalg::network_from_json(member(archive.payload, "judge", path), path);
  networks.check = linalg::network_from_json(member(archive.payload, "check", path), path);
  networks.sure = number_member(archive.payload, "sure", path, 0, 1);
  networks.likely = number_member(archive.payload, "likely", path, 0, 1);
  try {
    networks.require();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  return networks;
}

}  // namespace tarsier::face
