// SPDX-License-Identifier: MIT
#include "tarsier/media/model_store.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/media/user_models.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

namespace tarsier {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

// A folder with one model; restores TARSIER_MODELS afterwards.
class Models : public testing::Test {
 protected:
  Models() {
    if (const char* value = std::getenv("TARSIER_MODELS")) before_ = value;
    ::unsetenv("TARSIER_MODELS");
    ::unsetenv("TARSIER_OWN_MODELS");
    std::ofstream(folder_ / "head.json") << "{}";
  }
  ~Models() override {
    if (before_)
      ::setenv("TARSIER_MODELS", before_->c_str(), 1);
    else
      ::unsetenv("TARSIER_MODELS");
  }

  [[nodiscard]] const std::string& folder() const { return folder_.path(); }

  template <typename Failure, typename Call>
  static std::string failure_of(const Call& call) {
    try {
      call();
    } catch (const Failure& error) {
      return error.what();
    }
    return "no error";
  }

 private:
  TemporaryFolder folder_;
  std::optional<std::string> before_;
};

TEST_F(Models, AreFoundByName) {
  const ModelStore store(folder());
  EXPECT_TRUE(store.has("head.json"));
  EXPECT_FALSE(store.has("other.json"));
  EXPECT_EQ(store.path("head.json"), (fs::path(folder()) / "head.json").string());
  EXPECT_EQ(store.path_or("", "head.json"), store.path("head.json"));
  EXPECT_EQ(store.path_or("mine.json", "head.json"), "mine.json");
  EXPECT_EQ(store.expected_path("other.json"), (fs::path(folder()) / "other.json").string());
}

// Models that a user installed are used with the program's own folder, and only there.
TEST_F(Models, ModelsOfTheUserAreFoundInTheDataFolder) {
  const std::optional<std::string> before =
      std::getenv("XDG_DATA_HOME") ? std::optional(std::string(std::getenv("XDG_DATA_HOME")))
                                   : std::nullopt;
  ::setenv("XDG_DATA_HOME", folder().c_str(), 1);
  EXPECT_EQ(user_models_folder(), folder() + "/tarsier/models");
  fs::create_directories(user_models_folder());
  std::ofstream(user_models_folder() + "/installed.json") << "{}";
  EXPECT_FALSE(ModelStore(folder()).has("installed.json"));
  const ModelStore store = ModelStore::find();
  if (!store.folder().empty()) {
    EXPECT_TRUE(store.has("installed.json"));
    EXPECT_EQ(store.path("installed.json"), user_models_folder() + "/installed.json");
    EXPECT_EQ(store.expected_path("landmarks68.json"), store.folder() + "/landmarks68.json");
    EXPECT_FALSE(store.has("neither.json"));
  }
  ::setenv("XDG_DATA_HOME", "not absolute", 1);
  EXPECT_THAT(user_models_folder(), testing::Not(HasSubstr("not absolute")));
  if (before)
    ::setenv("XDG_DATA_HOME", before->c_str(), 1);
  else
    ::unsetenv("XDG_DATA_HOME");
}

TEST_F(Models, ErrorsNameTheMissingModelAndWhatToDo) {
  const ModelStore store(folder());
  const std::string error =
      failure_of<ModelError>([&] { static_cast<void>(store.path("other.json")); });
  EXPECT_THAT(error, HasSubstr((fs::path(folder()) / "other.json").string() + ": "));
  EXPECT_THAT(error, HasSubstr("set TARSIER_MODELS"));
}

TEST_F(Models, WithoutAFolderNoModelIsFound) {
  const ModelStore store;
  EXPECT_EQ(store.folder(), "");
  EXPECT_FALSE(store.has("head.json"));
  EXPECT_EQ(store.expected_path("head.json"), "head.json");
  EXPECT_THAT(failure_of<ModelError>([&] { static_cast<void>(store.path("head.json")); }),
              HasSubstr("head.json: no folder of models was found: set TARSIER_MODELS"));
}

TEST_F(Models, TheNamedFolderPrecedesTheEnvironmentAndTheShippedOne) {
  ::setenv("TARSIER_MODELS", "/nowhere", 1);
  EXPECT_EQ(ModelStore::find(folder()).folder(), folder());
  EXPECT_THAT(failure_of<ModelError>([] { static_cast<void>(ModelStore::find()); }),
              HasSubstr("/nowhere: no such folder of models"));
  ::setenv("TARSIER_MODELS", folder().c_str(), 1);
  EXPECT_EQ(ModelStore::find().folder(), folder());
  ::setenv("TARSIER_MODELS", "", 1);  // as if it were not set
  EXPECT_NE(ModelStore::find().folder(), folder());
  EXPECT_THAT(failure_of<ModelError>([] { static_cast<void>(ModelStore::find("/nowhere")); }),
              HasSubstr("/nowhere: no such folder of models"));
}

TEST_F(Models, ModelsOfTheUserReplaceThoseThatShip) {
  const TemporaryFolder own;
  const std::string own_model = (fs::path(own.path()) / "head.json").string();
  ::setenv("TARSIER_MODELS", folder().c_str(), 1);
  ::setenv("TARSIER_OWN_MODELS", own.path().c_str(), 1);
  const ModelStore store = ModelStore::find();
  EXPECT_FALSE(store.is_own("head.json"));
  EXPECT_EQ(store.path("head.json"), (fs::path(folder()) / "head.json").string());
  std::ofstream(own_model) << "{}";
  EXPECT_TRUE(store.is_own("head.json"));
  EXPECT_EQ(store.path("head.json"), own_model);
  EXPECT_EQ(store.expected_path("head.json"), own_model);
  EXPECT_EQ(store.shipped().path("head.json"), (fs::path(folder()) / "head.json").string());
  EXPECT_FALSE(store.shipped().is_own("head.json"));
  // If a folder is given, only that folder is used. A folder that does not exist has no models.
  EXPECT_FALSE(ModelStore::find(folder()).is_own("head.json"));
  ::setenv("TARSIER_OWN_MODELS", "/nowhere", 1);
  EXPECT_FALSE(ModelStore::find().is_own("head.json"));
  ::unsetenv("TARSIER_OWN_MODELS");
}

}  // namespace
}  // namespace tarsier
