// SPDX-License-Identifier: MIT
#include "tls_certificate.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sys/stat.h>

namespace tarsier::web {
namespace {

using TlsCertificate = FolderTest;

TEST_F(TlsCertificate, IsMadeOnceAndStored) {
  const TlsFiles first = self_signed_certificate(folder_, {"localhost", "127.0.0.1", "::1"});
  EXPECT_THAT(first.certificate, testing::StartsWith("-----BEGIN CERTIFICATE-----"));
  struct stat state {};
  ASSERT_EQ(::stat(path("tls-key.pem").c_str(), &state), 0);
  EXPECT_EQ(state.st_mode & 0777U, 0600U);
  EXPECT_EQ(self_signed_certificate(folder_, {"localhost", "::1"}).certificate, first.certificate);
  EXPECT_THAT(fingerprint_of(first.certificate),
              testing::MatchesRegex("[0-9A-F][0-9A-F](:[0-9A-F]+)+"));
  EXPECT_EQ(fingerprint_of(first.certificate).size(), 95U);
}

TEST_F(TlsCertificate, IsReplacedForAnotherName) {
  const TlsFiles first = self_signed_certificate(folder_, {"localhost"});
  const TlsFiles second =
      self_signed_certificate(folder_, {"localhost", "192.0.2.1", "studio.local"});
  EXPECT_NE(first.certificate, second.certificate);
  EXPECT_EQ(read_tls_files(path("tls-cert.pem"), path("tls-key.pem")).key, second.key);
  std::ofstream(path("tls-cert.pem")) << "damaged";
  EXPECT_THAT(self_signed_certificate(folder_, {"localhost"}).certificate,
              testing::HasSubstr("BEGIN CERTIFICATE"));
}

TEST_F(TlsCertificate, RefusesInvalidFiles) {
  EXPECT_THROW((void)read_tls_files(path("none.pem"), path("none.key")), InputError);
  std::ofstream(path("a.pem")) << "no PEM";
  EXPECT_THROW((void)read_tls_files(path("a.pem"), path("a.pem")), InputError);
  const TlsFiles files = self_signed_certificate(folder_, {"localhost"});
  EXPECT_THROW((void)read_tls_files(path("tls-cert.pem"), path("a.pem")), InputError);
}

}  // namespace
}  // namespace tarsier::web
