from setuptools import setup

NAME = "track_cpu_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/track_cpu.launch.py"]),
    ],
    install_requires=["setuptools", "track-cpu"],
    zip_safe=True,
    maintainer="the track-cpu authors",
    maintainer_email="maintainers@track-cpu.invalid",
    description="Follows one object through images on a CPU",
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": [f"track_cpu = {NAME}.node:main"]},
)
