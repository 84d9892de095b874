// The dependency arrows of docs/architecture.md, read from the includes.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/integration/process.h"

namespace teletact {
namespace {

namespace fs = std::filesystem;

struct Include {
  std::string file, folder, target;  // "service/rpc/x.cpp", "service/rpc", "service/scene/y.h" or <...>
};

std::vector<Include> includes_of(const std::string& side) {
  const fs::path root = test::required_environment("TELETACT_SOURCE_DIR");
  const std::regex pattern(R"re(^\s*#\s*include\s*[<"]([^>"]+)[>"])re");
  std::vector<Include> includes;
  for (const auto& entry : fs::recursive_directory_iterator(root / side)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".h" && extension != ".cpp") continue;
    const std::string file = fs::relative(entry.path(), root).string();
    std::ifstream text(entry.path());
    std::smatch match;
    for (std::string line; std::getline(text, line);)
      if (std::regex_search(line, match, pattern))
        includes.push_back({file, fs::path(file).parent_path().string(), match[1]});
  }
  return includes;
}

bool starts_with_any(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& p) { return text.rfind(p, 0) == 0; });
}

const std::vector<std::string> kRpcHeaders{"grpc", "google/protobuf", "teletact/v1/"};
const std::vector<std::string> kOpenClHeaders{"CL/", "OpenCL/"};

TEST(Arrows, ClientAndServiceDoNotIncludeEachOther) {
  const auto client = includes_of("client"), service = includes_of("service");
  ASSERT_GT(client.size(), 100u) << "the sources were not found";
  ASSERT_GT(service.size(), 100u) << "the sources were not found";
  for (const Include& i : client)
    EXPECT_FALSE(starts_with_any(i.target, {"service/"})) << i.file << ": " << i.target;
  for (const Include& i : service)
    EXPECT_FALSE(starts_with_any(i.target, {"client/"})) << i.file << ": " << i.target;
  for (const Include& i : includes_of("common"))  // what both share
    EXPECT_FALSE(starts_with_any(i.target, {"client/", "service/"})) << i.file << ": " << i.target;
}

// Each include of `side` from one of its folders to another must be in `allowed`; files of the side itself,
// main.cpp, may use all.
void expect_only(const std::map<std::string, std::set<std::string>>& allowed, const std::string& side) {
  for (const Include& i : includes_of(side)) {
    if (i.folder == side || i.target.rfind(side + "/", 0) != 0) continue;
    const std::string from = fs::path(i.folder).filename(), to = fs::path(i.target).parent_path().filename();
    ASSERT_TRUE(allowed.count(from)) << "a folder without a place: " << from;
    EXPECT_TRUE(from == to || allowed.at(from).count(to)) << i.file << " includes " << i.target;
  }
}

TEST(Arrows, TheServicesModulesDependOnlyOnThoseToTheirRight) {
  // operation -> rpc -> {imaging_plane, touch_plane} -> scene -> {imaging, contact} -> tissue -> solver ->
  // device
  // -> base; in imaging: imaging -> modulus -> tracking, in tissue: solid beside it; kernels are text for
  // device; access, who may do what, is rpc's.
  expect_only({{"base", {}},
               {"access", {"base"}},
               {"device", {"base"}},
               {"solver", {"device", "base"}},
               {"tissue", {"solver", "device", "base"}},
               {"solid", {"solver", "device", "base"}},
               {"contact", {"tissue", "solid", "solver", "device", "base"}},
               {"tracking", {"solver", "device", "base"}},
               {"modulus", {"tracking", "tissue", "solid", "solver", "device", "base"}},
               {"imaging", {"modulus", "tracking", "tissue", "solid", "solver", "device", "base"}},
               {"scene", {"imaging", "modulus", "tracking", "contact", "tissue", "solver", "device", "base"}},
               {"imaging_plane",
                {"scene", "imaging", "modulus", "tracking", "contact", "tissue", "solver", "device", "base"}},
               {"touch_plane", {"scene", "contact", "tissue", "solver", "device", "base"}},
               {"rpc",
                {"access", "imaging_plane", "touch_plane", "scene", "imaging", "modulus", "tracking",
                 "contact", "tissue", "solver", "device", "base"}},
               {"operation", {"rpc", "scene", "device", "base"}}},
              "service");
}

TEST(Arrows, TheClientsFoldersDependOnlyOnThoseToTheirRight) {
  // commands -> {session, recordings, report, stimuli}; recordings -> acquire; {session, report} -> link
  // -> servo -> haptic -> render; acquire -> link; stimuli -> {experiment, link}; experiment -> servo;
  // {acquire, report} -> patient; files and clock stand alone.
  expect_only({{"text", {}},
               {"files", {"text"}},
               {"matlab", {"files", "text"}},
               {"no_matlab", {"files"}},
               {"patient", {"files"}},
               {"render", {}},
               {"clock", {}},
               {"haptic", {"render", "clock"}},
               {"servo", {"haptic", "render", "clock"}},
               {"experiment", {"servo", "haptic", "render", "clock"}},
               {"link", {"servo", "haptic", "render", "clock", "text"}},
               {"stimuli", {"experiment", "link", "servo", "haptic", "render", "clock"}},
               {"watch", {"link", "servo", "render", "clock"}},
               {"session", {"link", "servo", "haptic", "render", "clock", "files"}},
               {"acquire", {"link", "clock", "patient", "files", "text"}},
               {"recordings", {"acquire", "files"}},
               {"report", {"link", "servo", "render", "clock", "patient", "files", "text"}},
               {"commands",
                {"session", "watch", "acquire", "recordings", "report", "stimuli", "experiment", "link",
                 "servo", "haptic", "render", "clock", "patient", "files", "text"}}},
              "client");
}

TEST(Arrows, TheProductKnowsNeitherBenchesNorTests) {
  for (const char* side : {"client", "service"})
    for (const Include& i : includes_of(side))
      EXPECT_FALSE(starts_with_any(i.target, {"bench/", "tests/"})) << i.file << ": " << i.target;
}

// suites -> what suites share -> {phantoms, fuzz} -> {peers, stability} -> basics. No suite knows another.
TEST(Arrows, SuitesOfTheBenchAreApart) {
  const std::map<std::string, std::set<std::string>> allowed{
      {"bench", {"bench/basics", "bench/load"}},
      {"bench/basics", {}},
      {"bench/peers", {"bench/basics"}},
      {"bench/independent", {}},
      {"bench/load", {}},
      {"bench/slow_opencl", {"bench/basics"}},
      {"bench/stability", {}},
      {"bench/phantoms", {"bench/peers", "bench/basics"}},
      {"bench/fuzz", {"bench/stability"}},
      {"bench/felt", {"bench", "bench/basics", "bench/independent"}},
      {"suite",
       {"bench", "bench/basics", "bench/felt", "bench/fuzz", "bench/independent", "bench/load", "bench/peers",
        "bench/phantoms", "bench/stability"}}};
  std::set<std::string> suites;
  for (const Include& i : includes_of("bench")) {
    if (i.target.rfind("bench/", 0) != 0) continue;
    const bool in_suite = i.folder.rfind("bench/suites/", 0) == 0;
    if (in_suite) suites.insert(i.folder);
    const std::string from = in_suite ? "suite" : i.folder, to = fs::path(i.target).parent_path();
    ASSERT_TRUE(allowed.count(from)) << "a folder without a place: " << from;
    EXPECT_TRUE(i.folder == to || allowed.at(from).count(to)) << i.file << " includes " << i.target;
  }
  EXPECT_GE(suites.size(), 8u) << "the suites were not found";
}

// What makes plane models, and what says where tissue is held, may know the tissue.
TEST(Arrows, ScenePlanesAndRpcSeeModelsThroughTheSeamAlone) {
  const std::set<std::string> makers{"service/scene/tissue_models.cpp", "service/scene/tissue_models.h",
                                     "service/scene/tissue_models.cpp", "service/scene/tissue_models.h",
                                     "service/scene/tissue_models.cpp"};
  std::size_t through = 0;
  for (const Include& i : includes_of("service")) {
    if (!starts_with_any(i.folder,
                         {"service/scene", "service/imaging_plane", "service/touch_plane", "service/rpc"}))
      continue;
    if (i.target.rfind("service/contact/", 0) != 0 && i.target.rfind("service/tissue/", 0) != 0) continue;
    const bool seam = i.target == "service/contact/touch_model.h" ||
                      i.target == "service/contact/contact_laws.h" ||
                      i.target == "service/contact/tactile_image.h";  // of a touch, whatever the model
    through += seam;
    const bool held = i.file == "service/scene/geometry.h" && i.target == "service/tissue/grid.h";
    EXPECT_TRUE(seam || held || makers.count(i.file)) << i.file << " includes " << i.target;
  }
  EXPECT_GE(through, 2u);
}

TEST(Arrows, EachLibraryIsIncludedByItsFolderOnly) {
  for (const Include& i : includes_of("service")) {
    if (i.folder != "service/device") {
      EXPECT_FALSE(starts_with_any(i.target, kOpenClHeaders)) << i.file;
    }
    if (i.folder != "service/rpc" && i.folder != "service") {
      EXPECT_FALSE(starts_with_any(i.target, kRpcHeaders)) << i.file << ": " << i.target;
    }
    if (i.folder != "service/access") {
      EXPECT_FALSE(starts_with_any(i.target, {"openssl/"})) << i.file << ": " << i.target;
    }
  }
}

TEST(Arrows, TimeCriticalFoldersKnowNoGrpcNorOpenCl) {
  const std::vector<std::string> pure{"client/servo",   "client/render", "client/haptic",    "client/clock",
                                      "client/patient", "client/files",  "client/experiment"};
  std::size_t seen = 0;
  for (const Include& i : includes_of("client")) {
    EXPECT_FALSE(starts_with_any(i.target, kOpenClHeaders)) << i.file;
    if (!starts_with_any(i.folder, pure)) continue;
    ++seen;
    EXPECT_FALSE(starts_with_any(i.target, kRpcHeaders)) << i.file << ": " << i.target;
  }
  EXPECT_GT(seen, 50u);
}

}  // namespace
}  // namespace teletact
