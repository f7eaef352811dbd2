// TEASER++'s part of the benchmark: a pose from correspondences.
#include <omp.h>
#include <teaser/registration.h>

#include <runner.hpp>

namespace {

// The points of one side of the correspondences: side 0 is the query's, 1 the map's.
Eigen::Matrix3Xd corresponding(const bench::Arguments& args, const std::string& cloud, std::size_t side) {
  const auto points = bench::array<float>(args.file(cloud + "_thin.f32"));
  const auto keypoints = bench::array<std::uint32_t>(args.file(cloud + "_keypoints.u32"));
  const auto pairs = bench::array<std::uint32_t>(args.file("correspondences.u32"));
  Eigen::Matrix3Xd chosen(3, static_cast<Eigen::Index>(pairs.size() / 2));
  for (std::size_t i = 0; 2 * i + 1 < pairs.size(); ++i) {
    const float* point = &points.at(3 * std::size_t{keypoints.at(pairs[2 * i + side])});
    chosen.col(static_cast<Eigen::Index>(i)) << point[0], point[1], point[2];
  }
  return chosen;
}

void ransac(const bench::Arguments& args) {
  omp_set_num_threads(args.threads);
  const Eigen::Matrix3Xd query = corresponding(args, "query", 0);
  const Eigen::Matrix3Xd map = corresponding(args, "map", 1);
  teaser::RobustRegistrationSolver::Params params;
  params.noise_bound = 2.0 * bench::setting(args, "voxel");
  params.estimate_scaling = false;
  bench::measure(
      args, "no RANSAC: maximum clique and graduated non-convexity; noise bound 2 v",
      [&] { return teaser::RobustRegistrationSolver(params).solve(query, map); },
      [](const teaser::RegistrationSolution& solution) {
        std::vector<double> pose(16, 0.0);
        for (int row = 0; row < 3; ++row) {
          for (int column = 0; column < 3; ++column) pose[4 * row + column] = solution.rotation(row, column);
          pose[4 * row + 3] = solution.translation(row);
        }
        pose[15] = 1.0;
        return bench::output(pose, 0);
      });
}

}  // namespace

int main(int argc, char** argv) { return bench::run(argc, argv, "TEASER++", TEASER_PACKAGE, {{"ransac", ransac}}); }
