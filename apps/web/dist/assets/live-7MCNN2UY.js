import{a,b,c}from"./chunk-FOKOEIAZ.js";import"./chunk-5AYSFJJD.js";import"./chunk-6YIATIHI.js";export{c as Live,b as LiveFigures,a as WALL};
