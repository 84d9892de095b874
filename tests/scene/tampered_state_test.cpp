// State that a hand has been at, or that lies where others may write.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "service/scene/scenes.h"
#include "tests/scene/create_scene.h"
#include "tests/scene/published.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class TamperedState : public testing::Test {
 protected:
  TamperedState() : folder(fs::temp_directory_path() / ("teletact-tampered-" + std::to_string(getpid()))) {
    fs::create_directories(folder / "state");
    std::ofstream(victim()) << "somebody's";
  }
  ~TamperedState() override { fs::remove_all(folder); }
  fs::path state() const { return folder / "state"; }
  fs::path victim() const { return folder / "victim"; }
  void make_scene() {
    Scenes scenes(state());
    create_scene(scenes, "a", tissue(0.12, 0.03), std::nullopt);
    publish_into(scenes, scenes.find("a"), window_of(homogeneous(10e3), 0.03, 0.03, 0.03));
  }
  std::size_t scenes_served() const {
    Scenes scenes(state());
    scenes.restore();
    return scenes.list().size();
  }
  const fs::path folder;
};

TEST_F(TamperedState, NoNumberOfTheDescriptionChangesUnnoticed) {
  make_scene();
  const std::string map_folder = (state() / "scenes" / "a").string() + "/";
  const json whole = json::parse(text_of(map_folder + "scene.json"));
  const auto map_of = [&](const std::string& name) { return text_of(map_folder + name); };
  EXPECT_NO_THROW(decoded(whole.dump(1), map_of, Limits{}));
  std::size_t changed = 0;
  const json flat = whole.flatten();
  for (const auto& [pointer, value] : flat.items()) {
    if (!value.is_number()) continue;
    json other = whole;
    json& number = other[json::json_pointer(pointer)];
    number = value.is_number_float() ? json(value.get<double>() * 0.999 + 1e-9) : json(value.get<int>() + 1);
    EXPECT_THROW(decoded(other.dump(1), map_of, Limits{}), std::exception) << pointer;
    ++changed;
  }
  EXPECT_GT(changed, 10U);
  std::string stiffer = text_of(map_folder + "scene.json");
  const std::string before = "\"poisson_ratio\": ";
  stiffer.replace(stiffer.find(before) + before.size(), 4, "0.41");
  try {
    decoded(stiffer, map_of, Limits{});
    ADD_FAILURE() << "served";
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("checksum"), std::string::npos) << error.what();
  }
}

// Nobody writes to that pipe, or reads it: the start would wait for ever, and say nothing.
TEST_F(TamperedState, PipesAndFilesWithoutEndHoldNoStart) {
  make_scene();
  const auto replaced = [&](const char* name) {
    fs::remove(state() / name);
    return state() / name;
  };
  for (const bool pipe : {true, false}) {
    if (pipe) {
      ASSERT_EQ(::mkfifo(replaced("versions.json").c_str(), 0600), 0);
    } else {
      fs::create_symlink("/dev/zero", replaced("versions.json"));
    }
    EXPECT_EQ(scenes_served(), 1U);
    EXPECT_TRUE(json::parse(text_of(state() / "versions.json")).contains("first_unused")) << "written anew";
  }
  for (const char* name : {"lock", "versions.json.tmp"}) {
    ASSERT_EQ(::mkfifo(replaced(name).c_str(), 0600), 0);
    try {
      Scenes scenes(state());
      ADD_FAILURE() << name << " is taken";
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(std::string(name) + ": it is a pipe"), std::string::npos)
          << error.what();
    }
    fs::remove(state() / name);
  }
  EXPECT_EQ(scenes_served(), 1U);
}

TEST_F(TamperedState, LinksAreNotWrittenThrough) {
  for (const char* name : {"lock", "versions.json.tmp"}) {
    fs::create_symlink(victim(), state() / name);
    try {
      Scenes scenes(state());
      ADD_FAILURE() << name << " is followed";
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find("symbolic link"), std::string::npos) << error.what();
    }
    EXPECT_EQ(text_of(victim()), "somebody's") << name;
    fs::remove(state() / name);
  }
  fs::create_directories(state() / "scenes" / "a");
  fs::create_directory(folder / "elsewhere");
  fs::create_symlink(victim(), state() / "scenes" / "a" / "scene.json.tmp");
  fs::create_directory_symlink(folder / "elsewhere", state() / "scenes" / "b");
  {
    Scenes scenes(state());
    for (const char* id : {"a", "b"}) try {
        create_scene(scenes, id, tissue(0.12, 0.03), std::nullopt);
      } catch (const std::exception&) {
      }
  }
  EXPECT_EQ(text_of(victim()), "somebody's");
  EXPECT_TRUE(fs::is_empty(folder / "elsewhere"));
}

}  // namespace
}  // namespace teletact::service
