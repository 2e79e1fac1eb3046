// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::face {
namespace {

constexpr int kFaceNetworksVersion = 1;

void list_face_networks(linalg::ModelFields& file, FaceNetworks& networks) {
  file.network("scan", networks.scan);
  file.network("judge", networks.refine);
  file.network("check", networks.verify);
  file.number("sure", networks.confident_score, 0, 1);
  file.number("likely", networks.likely_score, 0, 1);
}

}  // namespace

void write_face_networks(const std::string& path, const FaceNetworks& networks,
                         const nlohmann::json& provenance) {
  networks.require();
  write_archive(path, {std::string(kFaceNetworksType), kFaceNetworksVersion, provenance,
                       linalg::written(networks, list_face_networks)});
}

FaceNetworks read_face_networks(const std::string& path) {
  auto networks = linalg::read_fields<FaceNetworks>(
      read_archive(path, kFaceNetworksType, kFaceNetworksVersion).payload, path,
      list_face_networks);
  try {
    networks.require();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  return networks;
}

}  // namespace tarsier::face
