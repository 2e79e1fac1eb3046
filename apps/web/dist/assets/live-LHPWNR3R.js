import{a,b,c}from"./chunk-VLMDQHXG.js";import"./chunk-VSDYETHS.js";import"./chunk-ZJKHKGPO.js";export{c as Live,b as LiveFigures,a as WALL};
