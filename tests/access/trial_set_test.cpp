#include "service/access/trial_set.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <iterator>

#include "service/access/access_file.h"
#include "service/access/certificates.h"
#include "tests/access/access_folder.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

const WallClock::time_point kEnd{std::chrono::hours(1'000'000)};  // 2084

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

mode_t mode_of(const fs::path& path) {
  struct stat found {};
  EXPECT_EQ(::stat(path.c_str(), &found), 0) << path;
  return found.st_mode & 07777;
}

std::string why_refused(const fs::path& folder, const std::string& host) {
  try {
    make_trial_set(folder, host, kEnd);
    return "";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.what();
  }
}

TEST(TrialSet, HasATokenAndACertificateOfEachRoleForItsOwnerAlone) {
  AccessFolder folder;
  const fs::path out = folder / "set";
  make_trial_set(out, "node7", kEnd);
  EXPECT_EQ(mode_of(out), 0700U);
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(out)) {
    EXPECT_EQ(mode_of(entry.path()), 0600U) << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 2 + 2 + 4 * 3 + 1U);
  const AccessTable table = read_access(out / "access.toml");
  EXPECT_EQ(table.size(), 4U);
  for (const char* name : {"patient", "operator", "observer", "administrator"}) {
    std::string token = text_of(out / (std::string(name) + ".token"));
    ASSERT_EQ(token.back(), '\n');
    token.pop_back();
    const Principal& known = table.known({.token = digest_of(token)}, kEnd - std::chrono::seconds(1));
    EXPECT_EQ(known.name, name);
    EXPECT_EQ(known.roles, (std::map<std::string, Role>{{"*", *role_of(name)}}));
    EXPECT_THROW(table.known({.token = digest_of(token)}, kEnd), AccessRefused);
    const std::string certificate = text_of(out / (std::string(name) + ".pem"));
    require_pair(certificate, text_of(out / (std::string(name) + "-key.pem")));
    EXPECT_EQ(end_of(certificate), kEnd);
    EXPECT_THROW(require_pair(certificate, text_of(out / "server-key.pem")), std::runtime_error);
  }
  require_pair(text_of(out / "ca.pem"), text_of(out / "ca-key.pem"));
  require_pair(text_of(out / "server.pem"), text_of(out / "server-key.pem"));
}

TEST(TrialSet, NothingIsWrittenOver) {
  AccessFolder folder;
  const fs::path out = folder / "set";
  fs::create_directory(out);
  ::chmod(out.c_str(), 0755);
  EXPECT_EQ(why_refused(out, "localhost"), "") << "an empty folder will do";
  EXPECT_EQ(mode_of(out), 0700U);
  const std::string before = text_of(out / "operator.token");
  EXPECT_NE(why_refused(out, "localhost").find("--out"), std::string::npos);
  EXPECT_EQ(text_of(out / "operator.token"), before);
  EXPECT_NE(why_refused(folder / "no" / "such", "localhost").find("--out"), std::string::npos);
  EXPECT_NE(why_refused(folder.put("file", ""), "localhost").find("--out"), std::string::npos);
}

TEST(TrialSet, AHostThatIsNoneIsRefused) {
  AccessFolder folder;
  for (const std::string& host : {std::string(), std::string("a b"), std::string("a,DNS:b"),
                                  std::string("a\nb"), std::string(65, 'a')}) {
    EXPECT_NE(why_refused(folder / "set", host).find("--host"), std::string::npos) << host;
    EXPECT_FALSE(fs::exists(folder / "set")) << host;
  }
  EXPECT_EQ(why_refused(folder / "v4", "10.0.0.7"), "");
  EXPECT_EQ(why_refused(folder / "v6", "fd00::7"), "");
}

TEST(Certificates, WhatIsNoneIsRefused) {
  const Identity made = make_authority("test", kEnd);
  EXPECT_THROW(require_pair("", made.key), std::runtime_error);
  EXPECT_THROW(require_pair(made.certificate, ""), std::runtime_error);
  EXPECT_THROW(require_pair(made.key, made.certificate), std::runtime_error);
  EXPECT_THROW(require_pair(made.certificate, make_authority("test", kEnd).key), std::runtime_error);
  EXPECT_THROW(end_of("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"), std::runtime_error);
}

}  // namespace
}  // namespace teletact::service
