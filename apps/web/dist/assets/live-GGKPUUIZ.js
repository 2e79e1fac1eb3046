import{a,b,c}from"./chunk-P3ABNPIY.js";import"./chunk-XCQHX2TU.js";import"./chunk-5MIVZWZB.js";export{c as Live,b as LiveFigures,a as WALL};
