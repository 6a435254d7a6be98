"""An ament package in Python."""

from setuptools import setup

NAME = "steelyard_ros2"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    maintainer="The steelyard developers",
    maintainer_email="steelyard@example.org",
    description="Forwards topics to steelyard watch and publishes its estimates.",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"bridge = {NAME}.node:main"]},
)
